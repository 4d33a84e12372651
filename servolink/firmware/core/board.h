/* Servo board of the protocol: bytes of a host in, bytes and pulses out.

   The core has no heap, no clock, no interrupts and no floating point. Everything outside comes through `struct
   board_ports` and the times that callers pass. All times are microseconds of one clock that never goes backwards.

   No function blocks, whatever the host sends or fails to read, whatever is stored and whatever the flash is doing: the
   work of each call has a bound, and what is left is done by the next ones. A stop or a release acts within 5 ms of its
   last byte, and in its turn if that comes earlier. */

#ifndef SERVOLINK_BOARD_H
#define SERVOLINK_BOARD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define BOARD_SERVOS 16U          /* most servos, with ids from 1 */
#define BOARD_BUTTONS 8U          /* most buttons, with ids from 1 */
#define BOARD_PERIOD 20000U       /* microseconds between two pulses of a servo */
#define BOARD_FLASH_SECTOR 4096U  /* bytes erased at once */
#define BOARD_FLASH_PAGE 256U     /* bytes programmed at once, at most; they never cross a page */
#ifndef BOARD_MEMORY
#define BOARD_MEMORY 65536U       /* bytes for records, each with a header of 16 bytes */
#endif

/* Range of a servo, in the image because no packet carries it. Angles between are linear. */
struct board_range {
    uint16_t shortest, longest; /* pulse width in microseconds at the least and at the greatest angle */
    int16_t least, greatest;    /* degrees */
};

/* Settings in the image. `servolink firmware install` finds them by `magic` and replaces what follows. All numbers are
   little-endian, without padding. */
#define BOARD_SETTINGS_MAGIC "servolink board\001"
struct board_settings {
    char magic[16];                               /* BOARD_SETTINGS_MAGIC, without a NUL */
    uint8_t servos, buttons;                      /* how many there are */
    uint16_t battery_empty, battery_full;         /* millivolts; both 0: no battery is measured */
    uint16_t reserved;                            /* 0 */
    struct board_range ranges[BOARD_SERVOS];
};
#define BOARD_RANGE {500, 2500, -90, 90}

/* The hardware, as functions. All get `context`, none may call the core, and none may take longer than 1 ms. */
struct board_ports {
    void *context;

    /* Pulse width of a servo in nanoseconds, from its next pulse on; 0 releases it: no more pulses. Called whenever the
       width changes, at most once in BOARD_PERIOD except by a stop or a release. `servo` counts from 0. */
    void (*pulse)(void *context, unsigned servo, uint32_t nanoseconds);

    /* Flash for records: `flash_size` bytes, at least two banks of BOARD_MEMORY * 3 / 2, each of whole sectors. `erase` and
       `program` begin and return at once; `bytes` may be gone afterwards. No function but `busy` is called while busy. */
    uint32_t flash_size;
    void (*erase)(void *context, uint32_t offset);
    void (*program)(void *context, uint32_t offset, const uint8_t *bytes, uint32_t size);
    bool (*busy)(void *context);
    void (*read)(void *context, uint32_t offset, uint8_t *bytes, uint32_t size);

    uint32_t (*battery)(void *context); /* millivolts */
    uint32_t (*buttons)(void *context); /* bit 0 is button 1; 1 is pressed. Asked once in BOARD_PERIOD, and debounced */
    void (*alive)(void *context);       /* called once in BOARD_PERIOD: restart the watchdog here and nowhere else */
};

struct board; /* allocated by the caller: `core/state.h` has the definition, `board_size` the size */

size_t board_size(void);

/* Power up: read the records from flash, which must not be busy. Servos are released. `settings` and `ports` must stay. */
void board_start(struct board *board, const struct board_settings *settings, const struct board_ports *ports, uint64_t now);

/* Do what is due: macros, pulses, buttons, flash. Call it as often as possible, at least every 2 ms. */
void board_tick(struct board *board, uint64_t now);

/* How many bytes `board_receive` has room for. Less than a whole frame only while requests wait for their turn. */
size_t board_room(const struct board *board);

/* Bytes from the host, cut anywhere, no more than there is room for. At most one request acts; true if more than that is
   to be done, which the next calls do, also those without bytes, and each tick. */
bool board_receive(struct board *board, uint64_t now, const uint8_t *bytes, size_t size);

/* Copy up to `size` bytes for the host to `bytes` and return how many. Responses are made while they are copied. */
size_t board_transmit(struct board *board, uint8_t *bytes, size_t size);

/* The host detached: forget half a frame, unsent responses and its subscription. Motion goes on. */
void board_detach(struct board *board);

#endif
