/* Frames for the host. A frame is there as a whole or not at all. */

#include "state.h"

/* Place in the ring for the next byte. */
static uint32_t place(const struct output *output) {
    uint32_t at = output->head + output->used;
    return at < OUTPUT_SIZE ? at : at - OUTPUT_SIZE;
}

static void put(struct output *output, uint32_t byte) {
    output->bytes[place(output)] = (uint8_t)byte;
    output->sum = (uint8_t)(output->sum + byte);
    output->used++;
}

static uint8_t take(struct output *output) {
    uint8_t byte = output->bytes[output->head];
    output->head = output->head + 1 < OUTPUT_SIZE ? output->head + 1 : 0;
    output->used--;
    return byte;
}

void output_number(struct board *board, uint32_t value, uint32_t size) {
    for (uint32_t i = 0; i < size; i++) put(&board->output, value >> 8 * i & 0xff);
}

void output_bytes(struct board *board, const uint8_t *bytes, uint32_t size) {
    struct output *output = &board->output;
    for (uint32_t part; size; bytes += part, size -= part) {
        uint8_t *to = &output->bytes[place(output)], sum = output->sum;
        part = (uint32_t)(output->bytes + OUTPUT_SIZE - to);
        if (part > size) part = size;
        for (uint32_t i = 0; i < part; i++) {
            to[i] = bytes[i];
            sum = (uint8_t)(sum + bytes[i]);
        }
        output->sum = sum;
        output->used += part;
    }
}

bool output_begin(struct board *board, uint32_t id, uint32_t length) {
    if (length > UINT16_MAX || length + 17 > OUTPUT_SIZE - board->output.used) return false;
    output_number(board, board->records.newest, 4);
    output_number(board, length + 9, 4);
    board->output.sum = 0;
    output_number(board, 0x1d054c13, 4);
    output_number(board, id, 2);
    output_number(board, length, 2);
    return true;
}

void output_end(struct board *board) { put(&board->output, board->output.sum); }

/* Number of four bytes at the head, which remain there. */
static uint32_t peek(const struct output *output) {
    uint32_t value = 0;
    for (uint32_t i = 0; i < 4; i++) value |= (uint32_t)output->bytes[(output->head + i) % OUTPUT_SIZE] << 8 * i;
    return value;
}

size_t board_transmit(struct board *board, uint8_t *bytes, size_t size) {
    struct output *output = &board->output;
    size_t done = 0;
    while (done < size) {
        if (output->left == 0) {
            if (output->used == 0 || peek(output) > board->records.written) break;
            for (uint32_t i = 0; i < 4; i++) take(output);
            output->left = peek(output);
            for (uint32_t i = 0; i < 4; i++) take(output);
        }
        bytes[done++] = take(output);
        output->left--;
    }
    return done;
}
