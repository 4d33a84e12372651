/* Hardware of a board, in memory: flash that takes its time and can lose its power, pulses, buttons, a battery. */

#ifndef SERVOLINK_HARDWARE_H
#define SERVOLINK_HARDWARE_H

#include "../core/board.h"

#define FLASH_SIZE (3U * BOARD_MEMORY)

struct hardware {
    uint64_t now; /* microseconds */
    uint8_t *flash;
    uint32_t pulses[BOARD_SERVOS]; /* nanoseconds */
    uint32_t pressed, millivolts, periods;
    uint32_t erases[FLASH_SIZE / BOARD_FLASH_SECTOR];
    uint32_t offset, size; /* of the operation in flash that goes on; size 0: none */
    bool is_erase;
    uint64_t until;
    uint8_t page[BOARD_FLASH_PAGE];
    struct board_settings settings;
    struct board_ports ports;
    struct board *board;
};

/* Hardware without power. `flash` may be NULL: it has its own then, which is blank. */
struct hardware *hardware_new(uint8_t *flash);
void hardware_delete(struct hardware *hardware);

/* Power up at the time `now`. */
void hardware_start(struct hardware *hardware);

/* Power is lost: an operation in flash stays half done, as the random number has it. */
void hardware_cut(struct hardware *hardware, uint32_t random);

/* The core's functions at the time `now`, which takes no time: all that was received has acted, but half a frame. */
void hardware_detach(struct hardware *hardware);
void hardware_tick(struct hardware *hardware);
void hardware_receive(struct hardware *hardware, const uint8_t *bytes, size_t size);
void hardware_receive_once(struct hardware *hardware, const uint8_t *bytes, size_t size); /* and one turn's acting */
size_t hardware_transmit(struct hardware *hardware, uint8_t *bytes, size_t size);

#endif
