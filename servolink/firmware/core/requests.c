/* All requests of the protocol. Each acts at once; refused ones change nothing and get what the document has for that. */

#include "state.h"

#include <string.h>

#define CAPTION 32U
#define BATTERY_FULL 1000U /* permil, also of a board that measures none */

#define HANDLER struct board *board, const struct request *request, const uint8_t *content, uint32_t length

/* Response to a request that has the next id. */
static bool begin(struct board *board, const struct request *request, uint32_t length) {
    return output_begin(board, request->id + 1U, length);
}

static void respond_number(struct board *board, const struct request *request, uint32_t value, uint32_t size) {
    if (!begin(board, request, size)) return;
    output_number(board, value, size);
    output_end(board);
}

static void respond_result(struct board *board, const struct request *request, bool result) {
    respond_number(board, request, result, 1);
}

static void respond_bytes(struct board *board, const struct request *request, const uint8_t *bytes, uint32_t size) {
    if (!begin(board, request, size)) return;
    output_bytes(board, bytes, size);
    output_end(board);
}

static const struct record *current(const struct board *board, uint32_t kind, int32_t id) {
    return record_current(board, kind, id);
}

/* 1 */

static void set_mode(HANDLER) {
    respond_result(board, request, 1); /* the old protocol is described nowhere, so the mode stays what it is */
}

static void clear_all(HANDLER) {
    bool changed = records_change(board, CLEAR, 0, NULL, 0);
    if (changed) macro_end(board);
    servos_adjust(board);
    respond_result(board, request, changed);
}

static void query_memory(HANDLER) {
    if (!begin(board, request, 8)) return;
    output_number(board, BOARD_MEMORY - board->records.live * UNIT, 4);
    output_number(board, BOARD_MEMORY, 4);
    output_end(board);
}

static void query_power(HANDLER) {
    uint32_t empty = board->settings->battery_empty, full = board->settings->battery_full;
    uint32_t permil = BATTERY_FULL;
    if (full > empty) {
        uint32_t battery = board->ports->battery(board->ports->context);
        if (battery < full) permil = battery <= empty ? 0 : (battery - empty) * 1000U / (full - empty);
    }
    respond_number(board, request, permil, 2);
}

static void ignore(HANDLER) {
}

/* 2 */

static void query_servo_list(HANDLER) {
    uint32_t count = board->settings->servos;
    if (!begin(board, request, 1 + count)) return;
    output_number(board, count, 1);
    for (uint32_t id = 1; id <= count; id++) output_number(board, id, 1);
    output_end(board);
}

static void query_servo(HANDLER) {
    uint32_t named = servos_named(board, content[0]), count = 0;
    for (uint32_t i = 0; i < BOARD_SERVOS; i++) count += named >> i & 1U;
    if (!begin(board, request, 1 + 11 * count)) return;
    output_number(board, count, 1);
    for (uint32_t i = 0; i < BOARD_SERVOS; i++) {
        if (!(named >> i & 1U)) continue;
        output_number(board, i + 1, 1);
        output_number(board, (uint32_t)servo_value(board, i), 2);
        output_number(board, 0, 4); /* current and temperature, which a hobby servo does not measure */
        output_number(board, 0, 2); /* type */
        output_number(board, board->servos[i].is_start, 1);
        output_number(board, board->servos[i].is_hold, 1);
    }
    output_end(board);
}

/* The response has the content of the request if all was set. For a servo that does not exist nothing fits, so none is
   sent. */
static void set_servo(HANDLER) {
    uint32_t named = servos_named(board, content[0]);
    if (!named || content[1] > 1 || content[2] > 1) return;
    for (uint32_t i = 0; i < BOARD_SERVOS; i++) {
        if (named >> i & 1U) servo_set(board, i, content[1], content[2]);
    }
    respond_bytes(board, request, content, length);
}

static void set_unit(HANDLER) {
    uint32_t named = servos_named(board, content[0]);
    if (!named || content[1] > 1) return;
    for (uint32_t i = 0; i < BOARD_SERVOS; i++) {
        if (named >> i & 1U) board->servos[i].is_adc = content[1];
    }
    respond_bytes(board, request, content, length);
}

/* Steps and intervals that the document allows: an interval is not negative. */
static bool are_steps(const uint8_t *steps, uint32_t count) {
    for (uint32_t i = 0; i < count; i++) {
        if (get_i16(steps + 5 * i + 3) < 0) return false;
    }
    return true;
}

static void execute_action(HANDLER) {
    if (are_steps(content + 1, content[0])) servos_move(board, board->now, content + 1, content[0], 65536);
}

static void execute_action_ex(HANDLER) {
    const struct record *action = current(board, ACTION, get_i32(content));
    if (!action) return;
    const uint8_t *bytes = record_content(action);
    uint32_t count = get_u16(bytes + 36);
    board->work += 5U * count;
    servos_move(board, board->now, bytes + 38, count, 65536);
}

/* 3 and 4: records, whose content is that of the request which added them */

static void query_list(HANDLER) {
    uint32_t count = 0;
    const struct record *record = NULL;
    while ((record = record_next(board, record))) count += record->kind == request->kind && record->died == NEVER;
    if (!begin(board, request, 2 + (4 + CAPTION) * count)) return;
    output_number(board, count, 2);
    while ((record = record_next(board, record))) {
        if (record->kind == request->kind && record->died == NEVER) output_bytes(board, record_content(record), 4 + CAPTION);
    }
    output_end(board);
}

static void query_record(HANDLER) {
    static const uint8_t none[38];
    const struct record *record = current(board, request->kind, get_i32(content));
    respond_bytes(board, request, record ? record_content(record) : none, record ? record->size : sizeof none);
}

static bool are_commands(const uint8_t *commands, uint32_t count) {
    for (const uint8_t *command = commands; command < commands + 12 * count; command += 12) {
        bool is_delay = command[4] == 1;
        if (command[4] > 2 || command[5] < 1 || command[5] > 100) return false; /* type and ratio */
        if (get_i16(command + 6) < 0 || get_i32(command + 8) < 0 || (is_delay && get_i32(command) < 0)) return false;
    }
    return true;
}

static bool are_buttons(const uint8_t *buttons, uint32_t count) {
    for (uint32_t i = 0; i < count; i++) {
        if (buttons[49 * i + 48] > 1) return false; /* uninterruptible */
    }
    return true;
}

static void add_record(HANDLER) {
    int32_t id = get_i32(content);
    bool is_valid = id != 0; /* in a response id 0 says that there is no such record */
    uint32_t count = get_u16(content + 36);
    if (request->kind == ACTION) is_valid = is_valid && are_steps(content + 38, count);
    if (request->kind == MACRO) is_valid = is_valid && are_commands(content + 38, count);
    if (request->kind == TABLE) is_valid = is_valid && are_buttons(content + 38, count);
    respond_result(board, request, is_valid && records_change(board, request->kind, id, content, length));
}

static void delete_record(HANDLER) {
    int32_t id = get_i32(content);
    bool is_there = current(board, request->kind, id);
    respond_result(board, request, is_there && records_change(board, request->kind | REMOVE, id, NULL, 0));
}

static void execute_macro(HANDLER) {
    macro_start(board, get_i32(content), true, false);
}

static void query_parameters(HANDLER) {
    const struct record *parameters = current(board, SERVO_PARAMETERS, 0);
    if (parameters) {
        respond_bytes(board, request, record_content(parameters), parameters->size);
    } else {
        respond_number(board, request, 0, 2);
    }
}

/* Parameters of all servos are one record, so that a request with many of them is one change. Stored ones that are no
   longer possible, as the settings in the image have changed, are dropped. */
static void add_parameters(HANDLER) {
    const struct record *old = current(board, SERVO_PARAMETERS, 0);
    const uint8_t *lists[2] = {old ? record_content(old) : NULL, content};
    const uint8_t *of_servo[BOARD_SERVOS] = {NULL};
    for (uint32_t list = 0; list < 2; list++) {
        for (uint32_t i = 0; lists[list] && i < get_u16(lists[list]); i++) {
            const uint8_t *parameter = lists[list] + 2 + 35 * i;
            if (servo_allows(board, parameter[0], get_i16(parameter + 1))) {
                of_servo[parameter[0] - 1] = parameter;
            } else if (lists[list] == content) {
                respond_result(board, request, 0);
                return;
            }
        }
    }
    uint8_t merged[2 + 35 * BOARD_SERVOS] = {0};
    uint32_t count = 0;
    for (uint32_t i = 0; i < BOARD_SERVOS; i++) {
        if (of_servo[i]) memcpy(merged + 2 + 35 * count++, of_servo[i], 35);
    }
    merged[0] = (uint8_t)count;
    bool changed = records_change(board, SERVO_PARAMETERS, 0, merged, 2 + 35 * count);
    servos_adjust(board);
    respond_result(board, request, changed);
}

static void write_project_id(HANDLER) {
    respond_result(board, request, records_change(board, PROJECT_ID, 0, content, length));
}

static void query_project_id(HANDLER) {
    const struct record *record = current(board, PROJECT_ID, 0);
    respond_number(board, request, record ? get_u32(record_content(record)) : 0, 4);
}

static void set_active_table(HANDLER) {
    bool is_there = current(board, TABLE, get_i32(content));
    respond_result(board, request, is_there && records_change(board, ACTIVE_TABLE, 0, content, length));
}

static void query_active_table(HANDLER) {
    const struct record *table = active_table(board);
    respond_number(board, request, table ? (uint32_t)table->id : 0, 4);
}

static void subscribe(HANDLER) {
    bool is_valid = content[0] <= 1;
    if (is_valid) board->subscribed = content[0];
    respond_result(board, request, is_valid);
}

static const struct request REQUESTS[] = { /* by id */
    {10010, 1, 0, 0, 0, 0, set_mode},
    {10020, 0, 0, 0, 0, 0, clear_all},
    {10030, 0, 0, 0, 0, 0, query_memory},
    {10040, 0, 0, 0, 0, 0, query_power},
    {10050, 0, 0, 0, 1, 0, ignore},
    {20010, 0, 0, 0, 0, 0, query_servo_list},
    {20020, 1, 0, 0, 0, 0, query_servo},
    {20030, 3, 0, 0, 0, 0, set_servo},
    {20040, 2, 0, 0, 0, 0, set_unit},
    {20050, 1, 0, 1, 5, 0, execute_action},
    {20060, 4, 0, 0, 0, 0, execute_action_ex},
    {30010, 0, 0, 0, 0, ACTION, query_list},
    {30020, 4, 0, 0, 0, ACTION, query_record},
    {30030, 38, 36, 2, 5, ACTION, add_record},
    {30040, 4, 0, 0, 0, ACTION, delete_record},
    {30050, 0, 0, 0, 0, MACRO, query_list},
    {30060, 4, 0, 0, 0, MACRO, query_record},
    {30070, 38, 36, 2, 12, MACRO, add_record},
    {30080, 4, 0, 0, 0, MACRO, delete_record},
    {30090, 4, 0, 0, 0, 0, execute_macro},
    {30100, 0, 0, 0, 0, 0, query_parameters},
    {30110, 2, 0, 2, 35, 0, add_parameters},
    {30120, 4, 0, 0, 0, 0, write_project_id},
    {30130, 0, 0, 0, 0, 0, query_project_id},
    {40010, 0, 0, 0, 0, TABLE, query_list},
    {40020, 4, 0, 0, 0, TABLE, query_record},
    {40030, 38, 36, 2, 49, TABLE, add_record},
    {40040, 4, 0, 0, 0, TABLE, delete_record},
    {40050, 4, 0, 0, 0, 0, set_active_table},
    {40060, 0, 0, 0, 0, 0, query_active_table},
    {40070, 1, 0, 0, 0, 0, subscribe},
};

const struct request *request_find(uint32_t id) {
    uint32_t low = 0, high = sizeof REQUESTS / sizeof REQUESTS[0];
    while (low < high) {
        uint32_t middle = (low + high) / 2U;
        if (REQUESTS[middle].id == id) return &REQUESTS[middle];
        if (REQUESTS[middle].id < id) {
            low = middle + 1U;
        } else {
            high = middle;
        }
    }
    return NULL;
}
