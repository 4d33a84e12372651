/* Records in RAM: a log of changes, in which a replaced or deleted record stays as long as anything may need it. */

#include "state.h"

#include <string.h>

const struct record *record_next(const struct board *board, const struct record *record) {
    const struct records *records = &board->records;
    const struct record *next = record ? record + record_units(record->size) : records->log;
    return next < records->log + records->used ? next : NULL;
}

const struct record *record_find(const struct board *board, uint32_t kind, int32_t id, uint32_t moment) {
    for (const struct record *record = NULL; (record = record_next(board, record));) {
        if (record->kind == kind && record->id == id && record_visible(record, moment)) return record;
    }
    return NULL;
}

uint32_t records_live(const struct board *board) {
    uint32_t units = 0;
    for (const struct record *record = NULL; (record = record_next(board, record));) {
        if (record->died == NEVER) units += record_units(record->size);
    }
    return units * UNIT;
}

static bool is_needed(const struct board *board, const struct record *record) {
    if (record->died == NEVER || record->born > board->records.written) return true;
    if (board->run.depth && record_visible(record, board->run.moment)) return true;
    return board->flash.copying && record_visible(record, board->flash.moment);
}

static void collect_garbage(struct board *board) {
    struct records *records = &board->records;
    uint32_t from = 0, to = 0;
    while (from < records->used) {
        uint32_t units = record_units(records->log[from].size);
        if (is_needed(board, &records->log[from])) {
            memmove(&records->log[to], &records->log[from], units * UNIT);
            to += units;
        }
        from += units;
    }
    records->used = to;
}

/* Add a record, or delete one (REMOVE), or delete all (CLEAR). False: there is no room, and nothing has changed. */
bool records_change(struct board *board, uint32_t kind, int32_t id, const uint8_t *content, uint32_t size) {
    struct records *records = &board->records;
    bool removes = kind == CLEAR || kind & REMOVE;
    uint32_t units = record_units(size);
    if (!removes) {
        const struct record *old = record_find(board, kind, id, records->newest);
        uint32_t live = records_live(board) - (old ? record_units(old->size) * UNIT : 0);
        if (live + units * UNIT > BOARD_MEMORY) return false;
    }
    if (units > LOG_UNITS - records->used) collect_garbage(board);
    if (units > LOG_UNITS - records->used) return false;
    uint32_t number = records->newest + 1;
    for (uint32_t at = 0; at < records->used; at += record_units(records->log[at].size)) {
        struct record *old = &records->log[at];
        bool same = old->kind == (kind & ~(uint32_t)REMOVE) && old->id == id;
        if (old->died == NEVER && (same || kind == CLEAR)) old->died = number;
    }
    struct record *added = &records->log[records->used];
    memset(added + units - 1, 0, UNIT);
    *added = (struct record){(uint8_t)kind, 0, (uint16_t)size, id, number, removes ? number : NEVER};
    if (size) memcpy(added + 1, content, size);
    records->used += units;
    records->newest = number;
    return true;
}
