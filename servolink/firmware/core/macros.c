/* Macros, and the buttons that start them. One macro runs at a time, with those that it calls. */

#include "state.h"

#include <string.h>

#define COMMANDS_AT_ONCE 4U    /* commands of a macro in one tick, so that a tick is short, */
#define STEPS_AT_ONCE 4096U    /* and steps of their actions after which no other one follows */
#define CHECKED_AT_ONCE 1024U  /* commands of macros whose check is one turn's */
#define SLOWEST UINT32_C(0x40000000) /* limit of a scale: 16,384 times as slow */
#define LONG_PRESS 1000000U

enum { RUN_ACTION, WAIT, RUN_MACRO };
enum { UNCHECKED, OPEN = 0xfe, BROKEN = 0xff }; /* marks; others are the levels of a macro, with those that it calls */
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

/* Go on with the check, by one command of the macro at the end of its path. That macro is popped when all is known of it. */
static void check_command(struct board *board) {
    struct check *check = &board->check;
    struct checked *end = &check->path[check->depth - 1U];
    struct record *macro = &board->records.log[end->place];
    const uint8_t *content = record_content(macro), *command = content + 38 + 12 * end->command;
    if (end->command == get_u16(content + 36)) {
        macro->mark = end->deepest < MACRO_DEPTH ? (uint8_t)(end->deepest + 1U) : BROKEN;
        check->depth--;
        return;
    }
    if (command[4] != WAIT) {
        const struct record *named = record_current(board, command[4] == RUN_MACRO ? MACRO : ACTION, get_i32(command));
        uint32_t mark = !named ? BROKEN : command[4] == RUN_MACRO ? named->mark : 1U;
        if (mark == UNCHECKED) { /* the command is looked at again when this is known */
            uint32_t place = (uint32_t)(named - board->records.log);
            board->records.log[place].mark = OPEN;
            check->path[check->depth++] = (struct checked){(uint16_t)place, 0, 0};
            return;
        }
        if (mark > MACRO_DEPTH) { /* missing, broken, or it calls itself */
            macro->mark = BROKEN;
            check->depth--;
            return;
        }
        if (command[4] == RUN_MACRO && mark > end->deepest) end->deepest = (uint8_t)mark;
    }
    end->command++;
}

static void respond(struct board *board, bool is_started) {
    if (!output_begin(board, 30091, 1)) return;
    output_number(board, is_started, 1);
    output_end(board);
}

void macro_check(struct board *board) {
    struct check *check = &board->check;
    for (uint32_t i = 0; i < CHECKED_AT_ONCE && check->depth; i++) {
        check_command(board);
        board->work += 12U;
    }
    if (check->depth) return;
    const struct record *macro = record_current(board, MACRO, check->macro);
    bool is_complete = macro->mark <= MACRO_DEPTH;
    if (is_complete) {
        macro_end(board);
        board->run.moment = board->records.newest;
        board->run.due = board->now;
        board->run.uninterruptible = check->uninterruptible;
        call(board, check->macro, 65536);
    }
    if (check->responds) respond(board, is_complete);
}

/* Marks keep what was found until actions or macros change, so each macro is looked through once. */
void macro_start(struct board *board, int32_t id, bool responds, bool uninterruptible) {
    struct records *records = &board->records;
    struct check *check = &board->check;
    const struct record *macro = record_current(board, MACRO, id);
    if (!macro) {
        if (responds) respond(board, false);
        return;
    }
    for (uint32_t i = 0; !records->is_checked && i < records->count; i++) records->log[records->index[i]].mark = UNCHECKED;
    records->is_checked = true;
    check->macro = id;
    check->responds = responds;
    check->uninterruptible = uninterruptible;
    check->depth = macro->mark == UNCHECKED;
    check->path[0] = (struct checked){(uint16_t)(macro - records->log), 0, 0};
    if (check->depth) records->log[check->path[0].place].mark = OPEN;
    macro_check(board);
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
    if (next) macro_start(board, next, false, false);
}

void macro_step(struct board *board) {
    struct run *run = &board->run;
    uint32_t steps = 0;
    for (uint32_t i = 0; i < COMMANDS_AT_ONCE && steps < STEPS_AT_ONCE && run->depth && run->due <= board->now; i++) {
        struct call *top = &run->calls[run->depth - 1];
        const uint8_t *content = record_content(record_find(board, MACRO, top->macro, run->moment));
        if (top->command == get_u16(content + 36)) {
            if (run->depth == 1 && run->next && board->check.depth) return; /* another check comes first */
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
    } else if (macro) {
        macro_start(board, macro, false, event == LONG && button[48]);
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
