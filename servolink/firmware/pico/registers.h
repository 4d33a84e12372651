/* Registers of the RP2040 that are used, and what the files of this folder have for each other. */

#ifndef SERVOLINK_REGISTERS_H
#define SERVOLINK_REGISTERS_H

#include "../core/board.h"

#define REG(address) (*(volatile uint32_t *)(uintptr_t)(address))
#define SET(address) REG((address) + 0x2000U)   /* sets the bits that are written */
#define CLEAR(address) REG((address) + 0x3000U) /* clears them */

#define SSI 0x18000000U
#define CLOCKS 0x40008000U
#define RESETS 0x4000c000U
#define PSM 0x40010000U
#define IO_BANK0 0x40014000U
#define IO_QSPI 0x40018000U
#define PADS_BANK0 0x4001c000U
#define XOSC 0x40024000U
#define PLL_USB 0x4002c000U
#define UART0 0x40034000U
#define ADC 0x4004c000U
#define PWM 0x40050000U
#define TIMER 0x40054000U
#define WATCHDOG 0x40058000U
#define USB_MEMORY 0x50100000U
#define USB 0x50110000U
#define SIO 0xd0000000U
#define NVIC 0xe000e100U

#define VBUS_PIN 24U /* high while the host gives power; a Pico W has something else there */

/* flash.c: the ports of the core; `flash_id` is 8 bytes that differ from chip to chip. */
#define FLASH_SIZE (3U * BOARD_MEMORY)
void flash_start(void);
void flash_id(uint8_t *bytes);
void flash_erase(void *context, uint32_t offset);
void flash_program(void *context, uint32_t offset, const uint8_t *bytes, uint32_t size);
bool flash_busy(void *context);
void flash_read(void *context, uint32_t offset, uint8_t *bytes, uint32_t size);

/* usb.c: a serial port. True while it is the line to the board: a program has it open, and its host is there and awake. Half
   a frame, unsent responses and the subscription are forgotten when that changes. */
void usb_start(void);
bool usb_poll(struct board *board, uint64_t now);

#endif
