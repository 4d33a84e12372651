/* State of a board, for the files of the core. Times are microseconds, pulse widths nanoseconds. */

#ifndef SERVOLINK_STATE_H
#define SERVOLINK_STATE_H

#include "board.h"

#define INPUT_SIZE (65535U + 9U + 8192U) /* a whole frame, and so much that its bytes are seldom moved */
#define OUTPUT_SIZE (BOARD_MEMORY + 1024U)
#define UNIT 16U                                     /* records occupy whole units, the first one is their header */
#define LOG_UNITS ((BOARD_MEMORY + 1024U) / UNIT)    /* some more, as deletions are records too until they are in flash */
#define MACRO_DEPTH 16U
#define MOST_RECORDS (BOARD_MEMORY / 64U + 4U) /* that are live: the content of most has at least 38 bytes */
#define ALL_SERVOS 255U
#define NEVER UINT32_MAX

/* Kinds of records. REMOVE is added for deletions. */
enum kind { ACTION = 1, MACRO, TABLE, SERVO_PARAMETERS, PROJECT_ID, ACTIVE_TABLE, CLEAR, REMOVE = 0x80 };

/* Header of a record, in the log in RAM and in flash. A record was there at change n if born <= n < died. */
struct record {
    uint8_t kind, mark; /* mark: of the check of a macro, until records change; 0 in flash */
    uint16_t size; /* bytes of content, which follow the header */
    int32_t id;
    uint32_t born; /* number of the change that added it */
    uint32_t died; /* number of the change that replaced or deleted it, or NEVER; in flash: checksum */
};

/* Stop or release of a servo that is among the bytes received: the last one, at least as much as all of them. */
struct stop {
    uint32_t at;
    uint64_t time; /* of the first one */
    bool is_start, is_hold;
};

/* Bytes received and not yet understood, as running sums: byte i is the difference of sums[i + 1] and sums[i]. The sum of
   any part is a difference too, so rejecting a frame costs the same whatever its length. */
struct input {
    uint32_t head, tail; /* bytes head to tail are there */
    uint32_t hopeless;   /* a frame that begins before this place is not waited for */
    uint32_t begun;      /* place after the last magic */
    uint32_t recent;     /* last four bytes */
    uint64_t last;       /* time of the last byte */
    uint32_t stops;      /* bits of the servos with a stop */
    struct stop stop[BOARD_SERVOS];
    uint8_t sums[INPUT_SIZE + 4U];
};

/* Frames to transmit, in a ring. Each follows the number of the change that must be in flash before it is transmitted, and
   its length. */
struct output {
    uint32_t head, used;
    uint32_t left; /* bytes of the frame that is being transmitted */
    uint8_t sum;
    uint8_t bytes[OUTPUT_SIZE];
};

struct records {
    uint32_t used;    /* units */
    uint32_t live;    /* units of the records that did not die */
    uint32_t newest;  /* number of the last change */
    uint32_t written; /* number of the last change that is in flash */
    bool is_checked;  /* the marks of macros are those of the records as they are */
    uint32_t count;
    int32_t ids[MOST_RECORDS]; /* of the live records, sorted */
    uint16_t index[MOST_RECORDS]; /* their places in the log */
    struct record log[LOG_UNITS];
};

/* Writing of flash. The bank that is not in use is erased in the background, and takes the records when the other is full. */
struct flash {
    uint32_t bank, tail, generation;
    uint32_t spare_checked; /* bytes of the spare bank that are blank */
    uint32_t summed;        /* bytes that are in the checksum of the record that is being written */
    uint32_t done;          /* bytes of that record which are written */
    bool copying;           /* records are being copied to the spare bank */
    uint32_t copied;        /* number of the last record that was copied */
    uint32_t moment;        /* number of the last change to be copied */
    struct record header;
};

struct servo {
    int32_t from, to; /* pulse widths at the start and at the end of the movement */
    uint64_t start, duration;
    uint32_t shown;     /* pulse width that the hardware has, 0 for none */
    int16_t adjusted;   /* degrees, of 30110 */
    uint64_t soft_until;
    bool is_start, is_hold, is_adc;
    bool placed; /* where it is, is known: it has had pulses since it was last released */
};

/* A macro that runs, within those that called it. */
struct call {
    int32_t macro;
    uint32_t scale;    /* duration of its commands, in 1/65536 */
    uint16_t command;  /* index of the next command */
    uint16_t repeated; /* how often that command was executed */
};

struct run {
    uint32_t depth; /* calls; 0: no macro runs */
    uint32_t moment; /* number of the last change when it started: it sees the records as they were */
    uint64_t due;
    bool uninterruptible;
    int32_t next; /* macro that starts when this one has ended, or 0 */
    struct call calls[MACRO_DEPTH];
};

/* Check of a macro that is to start, which may take several turns. Requests and buttons wait for its end. */
struct check {
    int32_t macro;
    bool responds, uninterruptible;
    uint32_t depth; /* macros on the path; 0: no check goes on */
    struct checked {
        uint16_t place;   /* of the macro, in the log */
        uint16_t command; /* index of the next command */
        uint8_t deepest;  /* levels of those that it calls */
    } path[MOST_RECORDS];
};

struct button {
    uint64_t since;
    bool seen, pressed, is_long;
};

struct board {
    const struct board_settings *settings;
    const struct board_ports *ports;
    uint64_t now;    /* time of the call that is being made */
    uint64_t period; /* time of the next period */
    uint32_t work;   /* bytes of requests, their actions and commands that were looked through since the last tick */
    bool subscribed;
    struct servo servos[BOARD_SERVOS];
    struct button buttons[BOARD_BUTTONS];
    struct run run;
    struct check check;
    struct flash flash;
    struct records records;
    struct output output;
    struct input input;
};

/* Numbers of frames and records. */
static inline uint16_t get_u16(const uint8_t *bytes) { return (uint16_t)(bytes[0] | bytes[1] << 8); }
static inline int16_t get_i16(const uint8_t *bytes) { return (int16_t)get_u16(bytes); }
static inline uint32_t get_u32(const uint8_t *bytes) { return get_u16(bytes) | (uint32_t)get_u16(bytes + 2) << 16; }
static inline int32_t get_i32(const uint8_t *bytes) { return (int32_t)get_u32(bytes); }

/* requests.c */
struct request {
    uint16_t id, length;             /* length of the content but for its repeated part */
    uint8_t count_at, count_size; /* where the count of that part is; size 0: it has none */
    uint8_t each;                 /* length of one of that part; 0: nothing is repeated */
    uint8_t kind;                 /* of the records that it is about */
    void (*act)(struct board *board, const struct request *request, const uint8_t *content, uint32_t length);
};
const struct request *request_find(uint32_t id);

/* input.c: judge and act, for a time that has a bound. True if something may be left to be done at once. */
bool input_step(struct board *board);

/* output.c: a response is begun, its content put, and ended; false if there is no room, and nothing may follow. */
bool output_begin(struct board *board, uint32_t id, uint32_t length);
void output_number(struct board *board, uint32_t value, uint32_t size);
void output_bytes(struct board *board, const uint8_t *bytes, uint32_t size);
void output_end(struct board *board);

/* records.c */
void copy_words(uint8_t *to, const uint8_t *from, uint32_t size); /* both at whole words; `to` may overlap the end of `from` */
const struct record *record_next(const struct board *board, const struct record *record); /* NULL: the first; or the end */
const struct record *record_current(const struct board *board, uint32_t kind, int32_t id);
const struct record *record_find(const struct board *board, uint32_t kind, int32_t id, uint32_t moment);
static inline const uint8_t *record_content(const struct record *record) { return (const uint8_t *)(record + 1); }
static inline uint32_t record_units(uint32_t size) { return 1U + (size + UNIT - 1U) / UNIT; }
static inline bool record_visible(const struct record *record, uint32_t moment) {
    return record->born <= moment && moment < record->died;
}
bool records_change(struct board *board, uint32_t kind, int32_t id, const uint8_t *content, uint32_t size);

/* flash.c */
void flash_load(struct board *board);
void flash_step(struct board *board);

/* servos.c */
uint32_t servos_named(const struct board *board, uint32_t id); /* bits of the servos that an id means */
bool servo_allows(const struct board *board, uint32_t id, int16_t correction); /* and its angles stay numbers of 16 bits */
void servos_adjust(struct board *board);
int32_t servo_value(const struct board *board, uint32_t index);
void servo_set(struct board *board, uint32_t index, bool is_start, bool is_hold);
uint32_t servos_move(struct board *board, uint64_t start, const uint8_t *steps, uint32_t count, uint32_t scale);
void servos_period(struct board *board);

/* macros.c */
void macro_start(struct board *board, int32_t id, bool responds, bool uninterruptible); /* if the check finds no fault */
void macro_check(struct board *board); /* go on with a check that was not over in the turn of its start */
void macro_end(struct board *board);
void macro_step(struct board *board);
const struct record *active_table(const struct board *board);
void buttons_period(struct board *board);

#endif
