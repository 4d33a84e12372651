/* Records in flash. A bank is a header and then the changes in their order, each with a checksum that depends on the
   generation of the bank. The valid bank with the highest generation counts, up to its first wrong checksum. */

#include "state.h"

#define BANK_KIND 0x53U

#define SUMMED 1024U /* bytes whose checksum is made in one step */

static uint32_t checksum(uint32_t sum, const uint8_t *bytes, uint32_t size) { /* CRC-32, by four bits */
    static const uint32_t table[16] = {
        0x00000000, 0x1db71064, 0x3b6e20c8, 0x26d930ac, 0x76dc4190, 0x6b6b51f4, 0x4db26158, 0x5005713c,
        0xedb88320, 0xf00f9344, 0xd6d6a3e8, 0xcb61b38c, 0x9b64c2b0, 0x86d3d2d4, 0xa00ae278, 0xbdbdf21c,
    };
    for (uint32_t i = 0; i < size; i++) {
        sum ^= bytes[i];
        sum = sum >> 4 ^ table[sum & 15U];
        sum = sum >> 4 ^ table[sum & 15U];
    }
    return sum;
}

static uint32_t header_sum(const struct record *header, uint32_t generation) {
    return checksum(~generation, (const uint8_t *)header, offsetof(struct record, died));
}

static uint32_t bank_size(const struct board *board) { return board->ports->flash_size / 2U; }

static void read(struct board *board, uint32_t bank, uint32_t offset, void *bytes, uint32_t size) {
    board->ports->read(board->ports->context, bank * bank_size(board) + offset, bytes, size);
}

static uint32_t bank_generation(struct board *board, uint32_t bank) { /* 0: the bank is not valid */
    struct record header;
    read(board, bank, 0, &header, sizeof header);
    bool valid = header.kind == BANK_KIND && header.size == 0 && header.died == header_sum(&header, header.born);
    return valid ? header.born : 0;
}

/* Read the record at the tail into the end of the log as a change. False: there is none. */
static bool load_record(struct board *board) {
    struct flash *flash = &board->flash;
    struct record header;
    if (flash->tail + UNIT > bank_size(board)) return false;
    read(board, flash->bank, flash->tail, &header, sizeof header);
    uint32_t size = header.size, units = record_units(size);
    if (header.born <= board->records.newest || header.born == NEVER || units * UNIT > bank_size(board) - flash->tail) return false;
    /* The frame buffer is empty before the board has started. */
    uint8_t *content = board->input.sums;
    read(board, flash->bank, flash->tail + UNIT, content, size);
    if (checksum(header_sum(&header, flash->generation), content, size) != header.died) return false;
    board->records.newest = header.born - 1;
    board->records.written = header.born;
    records_change(board, header.kind, header.id, content, size);
    flash->tail += units * UNIT;
    return true;
}

/* True if nothing is programmed from an offset to the end of its page. */
static bool is_blank(struct board *board, uint32_t bank, uint32_t offset) {
    uint8_t bytes[BOARD_FLASH_PAGE], all = 0xff;
    uint32_t size = BOARD_FLASH_PAGE - offset % BOARD_FLASH_PAGE;
    read(board, bank, offset, bytes, size);
    for (uint32_t i = 0; i < size; i++) all &= bytes[i];
    return all == 0xff;
}

void flash_load(struct board *board) {
    struct flash *flash = &board->flash;
    uint32_t generations[2] = {bank_generation(board, 0), bank_generation(board, 1)};
    flash->bank = generations[1] > generations[0];
    flash->generation = generations[flash->bank];
    flash->tail = UNIT;
    if (flash->generation == 0) {
        flash->tail = bank_size(board); /* full: the first change goes to the other bank */
        return;
    }
    while (load_record(board)) {}
    /* A change that was cut off is not to be written over: the bank is full then. */
    for (uint32_t at = flash->tail; at < bank_size(board); at += BOARD_FLASH_PAGE - at % BOARD_FLASH_PAGE) {
        if (!is_blank(board, flash->bank, at)) flash->tail = bank_size(board);
    }
}

/* Go on making the header of a record with its checksum. True: it is there. */
static bool make_header(struct flash *flash, const struct record *record) {
    if (flash->summed == 0) {
        flash->header = *record;
        flash->header.mark = 0;
        flash->header.died = header_sum(&flash->header, flash->generation + flash->copying);
    }
    uint32_t part = record->size - flash->summed;
    if (part > SUMMED) part = SUMMED;
    flash->header.died = checksum(flash->header.died, record_content(record) + flash->summed, part);
    flash->summed += part;
    return flash->summed == record->size;
}

/* Begin to program the next part of a record. True: all of it was programmed. */
static bool program(struct board *board, uint32_t bank, uint32_t offset, const struct record *record) {
    struct flash *flash = &board->flash;
    uint32_t size = record_units(record->size) * UNIT;
    if (flash->done == 0 && !make_header(flash, record)) return false;
    if (flash->done == size) return true;
    const uint8_t *bytes = flash->done ? (const uint8_t *)record + flash->done : (const uint8_t *)&flash->header;
    uint32_t at = offset + flash->done;
    uint32_t part = flash->done ? size - flash->done : UNIT;
    uint32_t page = BOARD_FLASH_PAGE - at % BOARD_FLASH_PAGE;
    if (part > page) part = page;
    board->ports->program(board->ports->context, bank * bank_size(board) + at, bytes, part);
    flash->done += part;
    return false;
}

static const struct record *copy_next(const struct board *board) {
    for (const struct record *record = NULL; (record = record_next(board, record));) {
        if (record->born > board->flash.copied && record_visible(record, board->flash.moment)) return record;
    }
    return NULL;
}

/* Go on copying all records to the spare bank, whose header comes last. */
static void copy_step(struct board *board) {
    struct flash *flash = &board->flash;
    const struct record *record = copy_next(board);
    if (record) {
        if (!program(board, 1 - flash->bank, flash->tail, record)) return;
        flash->tail += flash->done;
        flash->copied = record->born;
    } else {
        struct record header = {BANK_KIND, 0, 0, 0, flash->generation + 1, 0};
        if (!program(board, 1 - flash->bank, 0, &header)) return;
        flash->bank = 1 - flash->bank;
        flash->generation++;
        flash->copying = false;
        flash->spare_checked = 0;
        board->records.written = flash->moment;
    }
    flash->summed = flash->done = 0;
}

/* Check the next page of the spare bank, and begin to erase its sector unless it is blank. */
static void prepare_spare(struct board *board) {
    struct flash *flash = &board->flash;
    if (is_blank(board, 1 - flash->bank, flash->spare_checked)) {
        flash->spare_checked += BOARD_FLASH_PAGE;
    } else {
        flash->spare_checked -= flash->spare_checked % BOARD_FLASH_SECTOR;
        board->ports->erase(board->ports->context, (1 - flash->bank) * bank_size(board) + flash->spare_checked);
    }
}

/* Begin the next thing to be done in flash, if any. */
void flash_step(struct board *board) {
    struct flash *flash = &board->flash;
    if (board->ports->busy(board->ports->context)) return;
    if (flash->copying) {
        copy_step(board);
        return;
    }
    const struct record *record = NULL;
    if (board->records.written < board->records.newest) {
        while ((record = record_next(board, record)) && record->born <= board->records.written) {}
    }
    if (record && record_units(record->size) * UNIT <= bank_size(board) - flash->tail) {
        if (!program(board, flash->bank, flash->tail, record)) return;
        flash->tail += flash->done;
        flash->summed = flash->done = 0;
        board->records.written = record->born;
    } else if (flash->spare_checked < bank_size(board)) {
        prepare_spare(board);
    } else if (record) {
        flash->copying = true;
        flash->copied = 0;
        flash->moment = board->records.newest;
        flash->tail = UNIT;
    }
}
