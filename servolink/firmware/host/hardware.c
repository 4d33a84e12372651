#include "hardware.h"

#include <stdlib.h>
#include <string.h>

#define ERASE_DURATION 45000U
#define PROGRAM_DURATION 400U
#define PACKET 64U /* bytes that come together */

static void pulse(void *context, unsigned servo, uint32_t nanoseconds) {
    ((struct hardware *)context)->pulses[servo] = nanoseconds;
}

static void begin(struct hardware *hardware, bool is_erase, uint32_t offset, uint32_t size, uint32_t duration) {
    if (hardware->size || offset + size > FLASH_SIZE) abort(); /* the core must not do this */
    hardware->is_erase = is_erase;
    hardware->offset = offset;
    hardware->size = size;
    hardware->until = hardware->now + duration;
}

static void erase(void *context, uint32_t offset) {
    begin(context, true, offset, BOARD_FLASH_SECTOR, ERASE_DURATION);
    ((struct hardware *)context)->erases[offset / BOARD_FLASH_SECTOR]++;
}

static void program(void *context, uint32_t offset, const uint8_t *bytes, uint32_t size) {
    if (offset / BOARD_FLASH_PAGE != (offset + size - 1) / BOARD_FLASH_PAGE) abort();
    begin(context, false, offset, size, PROGRAM_DURATION);
    memcpy(((struct hardware *)context)->page, bytes, size);
}

static bool busy(void *context) {
    struct hardware *hardware = context;
    if (hardware->size == 0) return false;
    if (hardware->now < hardware->until) return true;
    for (uint32_t i = 0; i < hardware->size; i++) {
        uint8_t *byte = &hardware->flash[hardware->offset + i];
        *byte = hardware->is_erase ? 0xff : *byte & hardware->page[i];
    }
    hardware->size = 0;
    return false;
}

static void read(void *context, uint32_t offset, uint8_t *bytes, uint32_t size) {
    struct hardware *hardware = context;
    if (hardware->size) abort();
    memcpy(bytes, hardware->flash + offset, size);
}

static uint32_t battery(void *context) { return ((struct hardware *)context)->millivolts; }
static uint32_t buttons(void *context) { return ((struct hardware *)context)->pressed; }
static void alive(void *context) { ((struct hardware *)context)->periods++; }

struct hardware *hardware_new(uint8_t *flash) {
    struct hardware *hardware = calloc(1, sizeof *hardware);
    struct board *board = malloc(board_size());
    uint8_t *own = flash ? NULL : malloc(FLASH_SIZE);
    if (!hardware || !board || !(flash || own)) abort();
    if (own) memset(own, 0xff, FLASH_SIZE);
    hardware->flash = flash ? flash : own;
    hardware->settings = (struct board_settings){BOARD_SETTINGS_MAGIC, BOARD_SERVOS, BOARD_BUTTONS, 6000, 8400, 0, {{0}}};
    for (int i = 0; i < (int)BOARD_SERVOS; i++) hardware->settings.ranges[i] = (struct board_range)BOARD_RANGE;
    hardware->millivolts = 8400;
    hardware->ports = (struct board_ports){hardware, pulse, FLASH_SIZE, erase, program, busy, read, battery, buttons, alive};
    hardware->board = board;
    return hardware;
}

void hardware_delete(struct hardware *hardware) {
    free(hardware->flash);
    free(hardware->board);
    free(hardware);
}

void hardware_start(struct hardware *hardware) {
    board_start(hardware->board, &hardware->settings, &hardware->ports, hardware->now);
}

void hardware_cut(struct hardware *hardware, uint32_t random) {
    for (uint32_t i = 0; i < hardware->size; i++) {
        random = random * 1664525U + 1013904223U;
        uint8_t noise = (uint8_t)(random >> 24);
        uint8_t *byte = &hardware->flash[hardware->offset + i];
        if (hardware->is_erase) {
            *byte |= noise;
        } else if (noise & 3) { /* most bytes wholly, the others in part */
            *byte &= noise & 4 ? hardware->page[i] : 0xff;
        } else {
            *byte &= hardware->page[i] | noise;
        }
    }
    hardware->size = 0;
    memset(hardware->pulses, 0, sizeof hardware->pulses);
}

void hardware_tick(struct hardware *hardware) { board_tick(hardware->board, hardware->now); }

void hardware_detach(struct hardware *hardware) { board_detach(hardware->board); }

void hardware_receive(struct hardware *hardware, const uint8_t *bytes, size_t size) {
    for (size_t part; size; bytes += part, size -= part) {
        part = size < PACKET ? size : PACKET;
        bool is_left = board_receive(hardware->board, hardware->now, bytes, part);
        while (is_left) is_left = board_receive(hardware->board, hardware->now, NULL, 0);
    }
}

void hardware_receive_once(struct hardware *hardware, const uint8_t *bytes, size_t size) {
    board_receive(hardware->board, hardware->now, bytes, size);
}

size_t hardware_transmit(struct hardware *hardware, uint8_t *bytes, size_t size) {
    return board_transmit(hardware->board, bytes, size);
}
