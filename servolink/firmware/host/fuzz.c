/* Target for libFuzzer: bytes of a host, with time that passes and power that is lost between them. */

#include "hardware.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static uint8_t flash[FLASH_SIZE];
    static struct hardware *hardware;
    if (!hardware) {
        for (uint32_t i = 0; i < FLASH_SIZE; i++) flash[i] = 0xff;
        hardware = hardware_new(flash);
        hardware_start(hardware);
    }
    hardware_detach(hardware);
    for (size_t at = 0; at < size;) {
        uint8_t what = data[at++];
        size_t part = what % 64U < size - at ? what % 64U : size - at;
        hardware_receive(hardware, data + at, part);
        at += part;
        hardware->pressed = what;
        hardware->now += what < 250 ? what * 10U : 300000U;
        if (what == 255) {
            hardware_cut(hardware, (uint32_t)size);
            hardware_start(hardware);
        }
        hardware_tick(hardware);
        uint8_t bytes[512];
        if (what % 2) hardware_transmit(hardware, bytes, sizeof bytes);
        for (unsigned i = 0; i < BOARD_SERVOS; i++) {
            if (hardware->pulses[i] && (hardware->pulses[i] < 500000U || hardware->pulses[i] > 2500000U)) __builtin_trap();
        }
    }
    return 0;
}
