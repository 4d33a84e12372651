/* Macros, and the buttons that start them. One macro runs at a time, with those that it calls. */

#include "state.h"

#include <string.h>

#define COMMANDS_AT_ONCE 4U    /* commands of a macro in one tick, so that a tick is short */
#define SLOWEST UINT32_C(0x40000000) /* limit of a scale: 16,384 times as slow */
#define LONG_PRESS 1000000U

enum { RUN_ACTION, WAIT, RUN_MACRO };
enum { UNCHECKED, BEING_CHECKED, COMPLETE };
enum { PRESS = 1, LONG = 2, UP = 4 };

void macro_end(struct board *board) {
    board->run.depth = 0;
    board->run.next = 0;
}

/* False: too many are nested. */
static bool call(struct board *board, int32_t id, uint32_t scale) {
    struct run *run = &board->run;
    if (run->depth == MACRO_DEPTH) return false;
    run->calls[run->depth++] = (struct call){id, scale, 0, 0};
    return true;
}

/* Place of a record in the index, which is built for the check of a macro: looking for each record would take too long. */
static uint16_t *find_slot(struct board *board, uint32_t kind, int32_t id) {
    uint32_t at = ((uint32_t)id * 2654435761U >> 16) + kind;
    for (;; at++) {
        uint16_t *slot = &board->run.index[at % INDEX_SIZE];
        if (*slot == 0) return slot;
        const struct record *record = &board->records.log[*slot - 1];
        if (record->kind == kind && record->id == id) return slot;
    }
}

static void build_index(struct board *board) {
    struct records *records = &board->records;
    memset(board->run.index, 0, sizeof board->run.index);
    for (uint32_t at = 0; at < records->used; at += record_units(records->log[at].size)) {
        struct record *record = &records->log[at];
        if (record->died != NEVER || (record->kind != ACTION && record->kind != MACRO)) continue;
        record->mark = UNCHECKED;
        *find_slot(board, record->kind, record->id) = (uint16_t)(at + 1);
    }
}

/* True if all that a macro names is there, and it does not call itself. */
static bool is_complete(struct board *board, struct record *macro, uint32_t depth) {
    if (macro->mark != UNCHECKED || depth == MACRO_DEPTH) return macro->mark == COMPLETE;
    macro->mark = BEING_CHECKED;
    const uint8_t *content = record_content(macro);
    for (uint32_t i = 0; i < get_u16(content + 36); i++) {
        const uint8_t *command = content + 38 + 12 * i;
        if (command[4] == WAIT) continue;
        uint16_t slot = *find_slot(board, command[4] == RUN_MACRO ? MACRO : ACTION, get_i32(command));
        if (slot == 0) return false;
        if (command[4] == RUN_MACRO && !is_complete(board, &board->records.log[slot - 1], depth + 1)) return false;
    }
    macro->mark = COMPLETE;
    return true;
}

bool macro_start(struct board *board, int32_t id) {
    build_index(board);
    uint16_t slot = *find_slot(board, MACRO, id);
    if (slot == 0 || !is_complete(board, &board->records.log[slot - 1], 0)) return false;
    macro_end(board);
    board->run.moment = board->records.newest;
    board->run.due = board->now;
    board->run.uninterruptible = false;
    return call(board, id, 65536);
}

/* Longest interval of an action, in microseconds. */
static uint64_t action_duration(const uint8_t *content) {
    uint32_t longest = 0;
    for (uint32_t i = 0; i < get_u16(content + 36); i++) {
        uint32_t interval = get_u16(content + 38 + 5 * i + 3);
        if (interval > longest) longest = interval;
    }
    return longest * UINT64_C(10000);
}

/* Execute a command once. False: too many macros are nested. */
static bool execute(struct board *board, const uint8_t *command, uint32_t scale) {
    struct run *run = &board->run;
    int32_t id = get_i32(command);
    uint64_t duration = 0;
    if (command[4] == RUN_MACRO) return call(board, id, scale);
    if (command[4] == WAIT) {
        duration = get_u32(command) * UINT64_C(1000);
    } else {
        const uint8_t *content = record_content(record_find(board, ACTION, id, run->moment));
        servos_move(board, run->due, content + 38, get_u16(content + 36), scale);
        duration = action_duration(content);
    }
    run->due += (duration >> 16) * scale + ((duration & 0xffff) * scale >> 16);
    return true;
}

static void end_of_run(struct board *board) {
    int32_t next = board->run.next;
    macro_end(board);
    if (next) macro_start(board, next);
}

void macro_step(struct board *board) {
    struct run *run = &board->run;
    for (uint32_t i = 0; i < COMMANDS_AT_ONCE && run->depth && run->due <= board->now; i++) {
        struct call *top = &run->calls[run->depth - 1];
        const uint8_t *content = record_content(record_find(board, MACRO, top->macro, run->moment));
        if (top->command == get_u16(content + 36)) {
            if (--run->depth == 0) end_of_run(board);
            continue;
        }
        const uint8_t *command = content + 38 + 12 * top->command;
        if (top->repeated == get_u16(command + 6)) {
            top->command++;
            top->repeated = 0;
            continue;
        }
        top->repeated++;
        uint64_t scale = (uint64_t)top->scale * 100U / command[5];
        if (!execute(board, command, (uint32_t)(scale < SLOWEST ? scale : SLOWEST))) macro_end(board);
    }
}

/* Table that was set; the only one, if none was set or that one was deleted. */
const struct record *active_table(const struct board *board) {
    uint32_t moment = board->records.newest;
    const struct record *active = record_find(board, ACTIVE_TABLE, 0, moment);
    const struct record *table = active ? record_find(board, TABLE, get_i32(record_content(active)), moment) : NULL;
    if (table) return table;
    for (const struct record *record = NULL; (record = record_next(board, record));) {
        if (record->kind != TABLE || record->died != NEVER) continue;
        if (table) return NULL;
        table = record;
    }
    return table;
}

static const uint8_t *find_button(const struct board *board, uint32_t id) {
    const struct record *table = active_table(board);
    if (!table) return NULL;
    const uint8_t *content = record_content(table);
    for (uint32_t i = 0; i < get_u16(content + 36); i++) {
        if (get_u32(content + 38 + 49 * i) == id) return content + 38 + 49 * i;
    }
    return NULL;
}

static void button_event(struct board *board, uint32_t id, uint32_t event) {
    if (board->subscribed && output_begin(board, 40081, 5)) {
        output_number(board, id, 4);
        output_number(board, event, 1);
        output_end(board);
    }
    const uint8_t *button = find_button(board, id);
    if (!button) return;
    int32_t macro = get_i32(button + (event == PRESS ? 36 : event == LONG ? 40 : 44));
    if (event == UP && board->run.depth && board->run.uninterruptible) {
        board->run.next = macro;
    } else if (macro && macro_start(board, macro)) {
        board->run.uninterruptible = event == LONG && button[48];
    }
}

void buttons_period(struct board *board) {
    uint32_t pressed = board->ports->buttons(board->ports->context);
    for (uint32_t i = 0; i < board->settings->buttons; i++) {
        struct button *button = &board->buttons[i];
        bool is_pressed = pressed >> i & 1U;
        bool is_stable = is_pressed == button->seen; /* in two periods, or it may bounce */
        button->seen = is_pressed;
        if (is_stable && is_pressed != button->pressed) {
            *button = (struct button){board->now, is_pressed, is_pressed, false};
            button_event(board, i + 1, is_pressed ? PRESS : UP);
        } else if (button->pressed && !button->is_long && board->now - button->since >= LONG_PRESS) {
            button->is_long = true;
            button_event(board, i + 1, LONG);
        }
    }
}
