/* Macros, and the buttons that start them. One macro runs at a time, with those that it calls. */

#include "state.h"

#include <string.h>

#define COMMANDS_AT_ONCE 4U    /* commands of a macro in one tick, so that a tick is short, */
#define STEPS_AT_ONCE 4096U    /* and steps of their actions after which no other one follows */
#define SLOWEST UINT32_C(0x40000000) /* limit of a scale: 16,384 times as slow */
#define LONG_PRESS 1000000U

enum { RUN_ACTION, WAIT, RUN_MACRO };
enum { UNCHECKED, TOO_MANY = 0xfe, BROKEN = 0xff }; /* marks, and what is found; others are the levels of a macro */
enum { PRESS = 1, LONG = 2, UP = 4 };

void macro_end(struct board *board) {
    board->run.depth = 0;
    board->run.next = 0;
}

/* There is room for the call, as the levels were counted. */
static void call(struct board *board, int32_t id, uint32_t scale) {
    struct run *run = &board->run;
    run->calls[run->depth++] = (struct call){id, scale, 0, 0};
}

/* Levels of a macro with those that it calls on its deepest path; BROKEN if something that it names is missing or if it
   calls itself, TOO_MANY if there are more than `most`. Marks keep what was found until actions or macros change, so each
   macro is looked through once; but not that there are too many levels, as another path may have room for them. */
static uint32_t levels(struct board *board, struct record *macro, uint32_t most) {
    if (macro->mark == BROKEN) return BROKEN;
    if (macro->mark > most || most == 0) return TOO_MANY;
    if (macro->mark != UNCHECKED) return macro->mark;
    macro->mark = BROKEN; /* for a macro that calls itself */
    board->work += get_u16(record_content(macro) + 36) * 12U;
    uint32_t deepest = 0;
    const uint8_t *command = record_content(macro) + 38;
    for (const uint8_t *end = command + 12 * get_u16(command - 2); command < end; command += 12) {
        if (command[4] == WAIT) continue;
        const struct record *named = record_current(board, command[4] == RUN_MACRO ? MACRO : ACTION, get_i32(command));
        if (!named) return BROKEN;
        if (command[4] == RUN_ACTION) continue;
        uint32_t found = named->mark;
        if (found == UNCHECKED || found >= most) {
            found = levels(board, &board->records.log[named - board->records.log], most - 1U);
        }
        if (found == TOO_MANY) macro->mark = UNCHECKED;
        if (found > MACRO_DEPTH) return found;
        if (found > deepest) deepest = found;
    }
    macro->mark = (uint8_t)(deepest + 1U);
    return macro->mark;
}

/* True if all that a macro names is there, and it calls neither itself nor too many levels, on any path. */
static bool is_complete(struct board *board, const struct record *macro) {
    struct records *records = &board->records;
    for (uint32_t i = 0; !records->is_checked && i < records->count; i++) records->log[records->index[i]].mark = UNCHECKED;
    records->is_checked = true;
    struct record *checked = &records->log[macro - records->log];
    bool is_complete = levels(board, checked, MACRO_DEPTH) <= MACRO_DEPTH;
    if (!is_complete) checked->mark = BROKEN; /* as no path to it has more room */
    return is_complete;
}

bool macro_start(struct board *board, int32_t id) {
    const struct record *macro = record_current(board, MACRO, id);
    if (!macro || !is_complete(board, macro)) return false;
    macro_end(board);
    board->run.moment = board->records.newest;
    board->run.due = board->now;
    board->run.uninterruptible = false;
    call(board, id, 65536);
    return true;
}

/* Execute a command once, and return how many steps that were. */
static uint32_t execute(struct board *board, const uint8_t *command, uint32_t scale) {
    struct run *run = &board->run;
    int32_t id = get_i32(command);
    uint64_t duration = 0;
    uint32_t steps = 0;
    if (command[4] == RUN_MACRO) {
        call(board, id, scale);
        return steps;
    }
    if (command[4] == WAIT) {
        duration = get_u32(command) * UINT64_C(1000);
    } else {
        const uint8_t *content = record_content(record_find(board, ACTION, id, run->moment));
        steps = get_u16(content + 36);
        duration = servos_move(board, run->due, content + 38, steps, scale) * UINT64_C(10000);
    }
    run->due += (duration >> 16) * scale + ((duration & 0xffff) * scale >> 16);
    return steps;
}

static void end_of_run(struct board *board) {
    int32_t next = board->run.next;
    macro_end(board);
    if (next) macro_start(board, next);
}

void macro_step(struct board *board) {
    struct run *run = &board->run;
    uint32_t steps = 0;
    for (uint32_t i = 0; i < COMMANDS_AT_ONCE && steps < STEPS_AT_ONCE && run->depth && run->due <= board->now; i++) {
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
        steps += execute(board, command, (uint32_t)(scale < SLOWEST ? scale : SLOWEST));
    }
}

/* Table that was set; the only one, if none was set or that one was deleted. */
const struct record *active_table(const struct board *board) {
    const struct record *active = record_current(board, ACTIVE_TABLE, 0);
    const struct record *table = active ? record_current(board, TABLE, get_i32(record_content(active))) : NULL;
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

/* One event in a period, as it may start a macro, which must be checked. That of another button comes in the next one. */
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
            return;
        } else if (button->pressed && !button->is_long && board->now - button->since >= LONG_PRESS) {
            button->is_long = true;
            button_event(board, i + 1, LONG);
            return;
        }
    }
}
