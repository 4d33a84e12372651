/* Frames in the bytes of the host. A frame is accepted if its id is that of a request, its length possible for that request
   and equal to the length that its count demands, and its sum right. A rejected one is searched for frames inside. */

#include "state.h"

#include <string.h>

#define PATIENCE 250000U /* a frame whose bytes stop for so long is rejected */

static const uint8_t MAGIC[4] = {0x13, 0x4c, 0x05, 0x1d};

enum verdict { INCOMPLETE, REJECTED, ACCEPTED };

static uint8_t input_byte(const struct input *input, uint32_t offset) {
    const uint8_t *sum = &input->sums[input->head + offset];
    return (uint8_t)(sum[1] - sum[0]);
}

static uint32_t input_u16(const struct input *input, uint32_t offset) {
    return input_byte(input, offset) | (uint32_t)input_byte(input, offset + 1) << 8;
}

/* Judge the bytes at the head, and set `length` to that of the content. */
static enum verdict judge(const struct input *input, const struct request **request, uint32_t *length) {
    uint32_t there = input->tail - input->head;
    for (uint32_t i = 0; i < sizeof MAGIC; i++) {
        if (i == there) return INCOMPLETE;
        if (input_byte(input, i) != MAGIC[i]) return REJECTED;
    }
    if (there < 8) return INCOMPLETE;
    *length = input_u16(input, 6);
    *request = request_find(input_u16(input, 4));
    if (!*request || *length < (*request)->length) return REJECTED;
    if ((*request)->each == 0 && *length != (*request)->length) return REJECTED;
    if ((*request)->count_size) {
        uint32_t at = 8U + (*request)->count_at;
        if (there < at + (*request)->count_size) return INCOMPLETE;
        uint32_t count = (*request)->count_size == 1 ? input_byte(input, at) : input_u16(input, at);
        if (*length != (*request)->length + count * (*request)->each) return REJECTED;
    }
    if (there < *length + 9) return INCOMPLETE;
    uint8_t sum = (uint8_t)(input->sums[input->head + *length + 8] - input->sums[input->head]);
    return sum == input_byte(input, *length + 8) ? ACCEPTED : REJECTED;
}

/* Replace the sums of the content by its bytes, which must be consumed afterwards. */
static const uint8_t *uncover(struct input *input, uint32_t length) {
    uint8_t *sums = &input->sums[input->head + 8];
    uint8_t before = sums[0];
    for (uint32_t i = 1; i <= length; i++) {
        uint8_t sum = sums[i];
        sums[i] = (uint8_t)(sum - before);
        before = sum;
    }
    return sums + 1;
}

static void parse(struct board *board) {
    struct input *input = &board->input;
    while (input->head != input->tail) {
        const struct request *request = NULL;
        uint32_t length = 0;
        enum verdict verdict = judge(input, &request, &length);
        if (verdict == INCOMPLETE) return;
        if (verdict == REJECTED) {
            input->head++;
        } else {
            request->act(board, request, uncover(input, length), length);
            input->head += length + 9;
        }
    }
}

void board_receive(struct board *board, uint64_t now, const uint8_t *bytes, size_t size) {
    struct input *input = &board->input;
    board->now = now;
    while (size) {
        if (input->tail == INPUT_SIZE) { /* more than a frame, so the head is far from 0 */
            memmove(input->sums, input->sums + input->head, input->tail - input->head + 1U);
            input->tail -= input->head;
            input->head = 0;
        }
        uint32_t room = INPUT_SIZE - input->tail;
        uint32_t part = size < room ? (uint32_t)size : room;
        for (uint32_t i = 0; i < part; i++, input->tail++) {
            input->sums[input->tail + 1] = (uint8_t)(input->sums[input->tail] + bytes[i]);
        }
        bytes += part;
        size -= part;
        input->last = now;
        parse(board);
    }
}

static void input_patience(struct board *board) {
    struct input *input = &board->input;
    if (board->now - input->last < PATIENCE) return;
    while (input->head != input->tail) {
        input->head++;
        parse(board);
    }
}

size_t board_size(void) { return sizeof(struct board); }

void board_start(struct board *board, const struct board_settings *settings, const struct board_ports *ports, uint64_t now) {
    memset(board, 0, sizeof *board);
    board->settings = settings;
    board->ports = ports;
    board->now = board->period = now;
    flash_load(board);
    servos_adjust(board);
}

void board_tick(struct board *board, uint64_t now) {
    board->now = now;
    input_patience(board);
    macro_step(board);
    if (now >= board->period) {
        while (board->period <= now) board->period += BOARD_PERIOD;
        buttons_period(board);
        servos_period(board);
        board->ports->alive(board->ports->context);
    }
    flash_step(board);
}

void board_detach(struct board *board) {
    board->input.head = board->input.tail = 0;
    board->output.used = board->output.left = 0;
    board->subscribed = false;
}
