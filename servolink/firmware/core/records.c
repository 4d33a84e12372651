/* Records in RAM: a log of changes, in which a replaced or deleted record stays as long as anything may need it. */

#include "state.h"

#include <string.h>

#define GARBAGE 0U /* kind of a record that is collected */

const struct record *record_next(const struct board *board, const struct record *record) {
    const struct records *records = &board->records;
    const struct record *next = record ? record + record_units(record->size) : records->log;
    return next < records->log + records->used ? next : NULL;
}

/* First of sorted numbers that is not below another one, or their end. A check of macros is mostly this. */
static const int32_t *first_from(const int32_t *numbers, uint32_t count, int32_t number) {
    while (count) {
        uint32_t half = count / 2U;
        if (numbers[half] < number) {
            numbers += half + 1U;
            count -= half + 1U;
        } else {
            count = half;
        }
    }
    return numbers;
}

/* Place in the index of the live record of a kind with an id. False: there is none, and one would have this place. */
static bool find_place(const struct records *records, uint32_t kind, int32_t id, uint32_t *at) {
    const int32_t *found = first_from(records->ids, records->count, id);
    for (*at = (uint32_t)(found - records->ids); *at < records->count && records->ids[*at] == id; (*at)++) {
        if (records->log[records->index[*at]].kind == kind) return true;
    }
    return false;
}

const struct record *record_current(const struct board *board, uint32_t kind, int32_t id) {
    uint32_t at;
    return find_place(&board->records, kind, id, &at) ? &board->records.log[board->records.index[at]] : NULL;
}

const struct record *record_find(const struct board *board, uint32_t kind, int32_t id, uint32_t moment) {
    const struct record *found = record_current(board, kind, id);
    if (found && found->born <= moment) return found;
    for (const struct record *record = NULL; (record = record_next(board, record));) {
        if (record->kind == kind && record->id == id && record_visible(record, moment)) return record;
    }
    return NULL;
}

static bool is_needed(const struct board *board, const struct record *record) {
    if (record->died == NEVER || record->born > board->records.written) return true;
    if (board->run.depth && record_visible(record, board->run.moment)) return true;
    return board->flash.copying && record_visible(record, board->flash.moment);
}

/* Move what is needed to the front. A live record has where it will be in place of NEVER, until the index was changed. */
static void collect_garbage(struct board *board) {
    struct records *records = &board->records;
    uint32_t to = 0;
    for (uint32_t from = 0, units; from < records->used; from += units) {
        struct record *record = &records->log[from];
        units = record_units(record->size);
        if (!is_needed(board, record)) {
            record->kind = GARBAGE;
            continue;
        }
        if (record->died == NEVER) record->died = to;
        to += units;
    }
    for (uint32_t i = 0; i < records->count; i++) {
        struct record *record = &records->log[records->index[i]];
        records->index[i] = (uint16_t)record->died;
        record->died = NEVER;
    }
    to = 0;
    for (uint32_t from = 0, end; from < records->used; from = end) {
        end = from + record_units(records->log[from].size);
        bool is_kept = records->log[from].kind != GARBAGE;
        for (uint32_t unit = from; is_kept && unit < end; unit++) records->log[to++] = records->log[unit];
    }
    records->used = to;
}

/* Let records die: a number of them, from a place of the index on. */
static void bury(struct records *records, uint32_t at, uint32_t count) {
    for (uint32_t i = at; i < at + count; i++) {
        struct record *record = &records->log[records->index[i]];
        record->died = records->newest;
        records->live -= record_units(record->size);
    }
    records->count -= count;
    memmove(&records->index[at], &records->index[at + count], (records->count - at) * sizeof records->index[0]);
    memmove(&records->ids[at], &records->ids[at + count], (records->count - at) * sizeof records->ids[0]);
}

/* Make the record that comes next in the log a live one, at a place of the index. */
static void insert(struct records *records, uint32_t at, int32_t id, uint32_t units) {
    memmove(&records->index[at + 1U], &records->index[at], (records->count - at) * sizeof records->index[0]);
    memmove(&records->ids[at + 1U], &records->ids[at], (records->count - at) * sizeof records->ids[0]);
    records->index[at] = (uint16_t)records->used;
    records->ids[at] = id;
    records->count++;
    records->live += units;
}

void copy_words(uint8_t *to, const uint8_t *from, uint32_t size) {
    to = __builtin_assume_aligned(to, sizeof(uint32_t));
    from = __builtin_assume_aligned(from, sizeof(uint32_t));
    for (uint32_t at = 0; at < size; at += (uint32_t)sizeof(uint32_t)) memcpy(to + at, from + at, sizeof(uint32_t));
}

/* Copy content, whose last unit is filled with zeros. That of a frame begins with a whole word. */
static void put_content(struct record *record, const uint8_t *content, uint32_t size) {
    uint8_t *to = (uint8_t *)(record + 1);
    uint32_t whole = (uintptr_t)content % sizeof(uint32_t) ? 0 : size & ~(UNIT - 1U);
    copy_words(to, content, whole);
    if (size == whole) return;
    memset(record + record_units(size) - 1U, 0, UNIT);
    memcpy(to + whole, content + whole, size - whole);
}

/* Add a record, or delete one (REMOVE), or delete all (CLEAR). False: there is no room, and nothing has changed. */
bool records_change(struct board *board, uint32_t kind, int32_t id, const uint8_t *content, uint32_t size) {
    struct records *records = &board->records;
    bool removes = kind == CLEAR || kind & REMOVE;
    uint32_t units = record_units(size), of = kind & ~(uint32_t)REMOVE;
    uint32_t at = 0;
    bool is_there = kind != CLEAR && find_place(records, of, id, &at);
    if (!removes) {
        uint32_t live = records->live - (is_there ? record_units(records->log[records->index[at]].size) : 0);
        if ((live + units) * UNIT > BOARD_MEMORY || records->count == MOST_RECORDS) return false;
    }
    if (units > LOG_UNITS - records->used) collect_garbage(board);
    if (units > LOG_UNITS - records->used) return false;
    records->newest++;
    bury(records, at, kind == CLEAR ? records->count : is_there);
    if (!removes) insert(records, at, id, units);
    struct record *added = &records->log[records->used];
    *added = (struct record){(uint8_t)kind, 0, (uint16_t)size, id, records->newest, removes ? records->newest : NEVER};
    put_content(added, content, size);
    records->used += units;
    if (of == ACTION || of == MACRO || of == CLEAR) records->is_checked = false;
    return true;
}
