/* Flash at the end of the chip, by commands on its SPI lines. */

#include "registers.h"

#define RECORDS (2U * 1024U * 1024U - FLASH_SIZE)

enum { PROGRAM = 0x02, READ = 0x03, STATUS = 0x05, ENABLE_WRITING = 0x06, ERASE_SECTOR = 0x20, UNIQUE_ID = 0x4b };

static void select_chip(bool is_selected) { REG(IO_QSPI + 0x0c) = is_selected ? 2U << 8 : 3U << 8; /* drive it low or high */ }

static uint8_t exchange(uint32_t byte) {
    REG(SSI + 0x60) = byte;
    while (!(REG(SSI + 0x28) & 8U)) {} /* until a byte was received */
    return (uint8_t)REG(SSI + 0x60);
}

static void command(uint32_t code) {
    select_chip(true);
    exchange(code);
}

static void command_at(uint32_t code, uint32_t offset) {
    command(code);
    for (uint32_t shift = 24; shift; shift -= 8) exchange((RECORDS + offset) >> (shift - 8) & 0xffU);
}

static void enable_writing(void) {
    command(ENABLE_WRITING);
    select_chip(false);
}

void flash_start(void) {
    select_chip(false);
    REG(SSI + 0x08) = 0;
    REG(SSI + 0x14) = 2;        /* half of the 48 MHz */
    REG(SSI + 0x00) = 7U << 16; /* 8 bits, both directions */
    REG(SSI + 0x10) = 1;
    REG(SSI + 0x08) = 1;
    while (flash_busy(NULL)) {} /* a reset may have come while it erased */
}

void flash_id(uint8_t *bytes) {
    command(UNIQUE_ID);
    for (int i = 0; i < 4; i++) exchange(0);
    for (int i = 0; i < 8; i++) bytes[i] = exchange(0);
    select_chip(false);
}

void flash_erase(void *context, uint32_t offset) {
    enable_writing();
    command_at(ERASE_SECTOR, offset);
    select_chip(false);
}

void flash_program(void *context, uint32_t offset, const uint8_t *bytes, uint32_t size) {
    enable_writing();
    command_at(PROGRAM, offset);
    for (uint32_t i = 0; i < size; i++) exchange(bytes[i]);
    select_chip(false);
}

bool flash_busy(void *context) {
    command(STATUS);
    bool is_busy = exchange(0) & 1U;
    select_chip(false);
    return is_busy;
}

void flash_read(void *context, uint32_t offset, uint8_t *bytes, uint32_t size) {
    command_at(READ, offset);
    for (uint32_t i = 0; i < size; i++) bytes[i] = exchange(0);
    select_chip(false);
}
