/* Frames in the bytes of the host. A frame is accepted if its id is that of a request, its length possible for that request
   and equal to the length that its count demands, and its sum right. A rejected one is searched for frames inside.

   Both may take longer than a stop may wait. So whole frames that look like one are noted when they come, and overtake
   what is in front of them when they have waited for OVERTAKING. In their turn they act again, and are answered. */

#include "state.h"

#include <string.h>

#define PATIENCE 250000U   /* a frame whose bytes stop for so long is rejected */
#define OVERTAKING 5000U
#define BEGINNINGS 2048U   /* places at which a frame may begin that are judged in one call */
#define MUCH 16384U        /* work after which what else may take long waits for the next tick */
#define MAGIC_NUMBER 0x1d054c13U
#define SET_SERVO 20030U

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

/* Replace the sums of the content by its bytes, which begin with a whole word and must be consumed afterwards. */
static const uint8_t *uncover(struct input *input, uint32_t length) {
    const uint8_t *sum = &input->sums[input->head + 8U], *end = sum + length;
    uint8_t *content = &input->sums[(input->head + 9U) & ~3U], *byte = content, before = *sum;
    while (sum != end) {
        uint8_t after = *++sum;
        *byte++ = (uint8_t)(after - before);
        before = after;
    }
    return content;
}

/* Note the frame of a request that sets servos, at the end of the bytes, if it is whole and stops or releases any. */
static void note_stop(struct board *board, uint32_t at) {
    struct input *input = &board->input;
    uint32_t offset = at - input->head;
    uint8_t sum = (uint8_t)(input->sums[at + 11U] - input->sums[at]), content[3];
    if (input_u16(input, offset + 4U) != SET_SERVO || input_u16(input, offset + 6U) != sizeof content) return;
    for (uint32_t i = 0; i < sizeof content; i++) content[i] = input_byte(input, offset + 8U + i);
    uint32_t named = servos_named(board, content[0]);
    bool stops = content[1] <= 1 && content[2] <= 1 && !(content[1] && content[2]);
    if (!stops || sum != input_byte(input, offset + 11U)) return;
    for (uint32_t i = 0; i < BOARD_SERVOS; i++) {
        if (!(named >> i & 1U)) continue;
        struct stop *stop = &input->stop[i];
        if (!(input->stops >> i & 1U)) *stop = (struct stop){0, board->now, true, true};
        stop->at = at;
        stop->is_start = stop->is_start && content[1];
        stop->is_hold = stop->is_hold && content[2];
    }
    input->stops |= named;
}

static void overtake(struct board *board) {
    struct input *input = &board->input;
    for (uint32_t i = 0; input->stops >> i; i++) {
        const struct stop *stop = &input->stop[i];
        bool is_over = stop->at < input->head, is_due = board->now - stop->time >= OVERTAKING;
        if (!(input->stops >> i & 1U) || !(is_over || is_due)) continue;
        if (!is_over) servo_set(board, i, stop->is_start, stop->is_hold);
        input->stops &= ~(1U << i);
    }
}

bool input_step(struct board *board) {
    struct input *input = &board->input;
    if (board->now - input->last >= PATIENCE) input->hopeless = input->tail;
    overtake(board);
    if (board->check.depth) {
        macro_check(board);
        return true;
    }
    for (uint32_t i = 0; i < BEGINNINGS; i++) {
        const struct request *request = NULL;
        uint32_t length = 0;
        if (input->head == input->tail) return false;
        enum verdict verdict = judge(input, &request, &length);
        if (verdict == INCOMPLETE && input->head >= input->hopeless) return false;
        if (verdict == ACCEPTED) {
            request->act(board, request, uncover(input, length), length);
            input->head += length + 9U;
            board->work += length + 9U;
            return input->head != input->tail;
        }
        input->head++;
    }
    return true;
}

/* Bytes in front of the head that can be given up: whole words. */
static uint32_t given_up(const struct input *input) { return input->head & ~3U; }

size_t board_room(const struct board *board) { return INPUT_SIZE - board->input.tail + given_up(&board->input); }

static uint32_t less(uint32_t place, uint32_t distance) { return place > distance ? place - distance : 0; }

/* Move the bytes to the front. */
static void make_room(struct input *input) {
    uint32_t distance = given_up(input);
    copy_words(input->sums, &input->sums[distance], input->tail - distance + 1U);
    input->head -= distance;
    input->tail -= distance;
    input->hopeless = less(input->hopeless, distance);
    input->begun = less(input->begun, distance);
    for (uint32_t i = 0; i < BOARD_SERVOS; i++) input->stop[i].at = less(input->stop[i].at, distance);
}

static void append(struct board *board, const uint8_t *bytes, uint32_t size) {
    struct input *input = &board->input;
    uint8_t sum = input->sums[input->tail];
    for (uint32_t i = 0; i < size; i++) {
        sum = (uint8_t)(sum + bytes[i]);
        input->sums[++input->tail] = sum;
        input->recent = input->recent >> 8 | (uint32_t)bytes[i] << 24;
        if (input->recent == MAGIC_NUMBER) input->begun = input->tail;
        if (input->tail - input->begun == 8U && input->begun >= input->head + 4U) note_stop(board, input->begun - 4U);
    }
}

bool board_receive(struct board *board, uint64_t now, const uint8_t *bytes, size_t size) {
    struct input *input = &board->input;
    board->now = now;
    board->work = 0;
    if (size) {
        if (size > board_room(board)) size = board_room(board);
        if (size > INPUT_SIZE - input->tail) make_room(input);
        append(board, bytes, (uint32_t)size);
        input->last = now;
    }
    return input_step(board);
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
    if (board->work == 0) input_step(board);
    if (board->work < MUCH) macro_step(board);
    if (now >= board->period) {
        while (board->period <= now) board->period += BOARD_PERIOD;
        if (board->work < MUCH && !board->check.depth) buttons_period(board);
        servos_period(board);
        board->ports->alive(board->ports->context);
    }
    flash_step(board);
    board->work = 0;
}

void board_detach(struct board *board) {
    board->input.head = board->input.tail = board->input.hopeless = board->input.begun = board->input.recent = 0;
    board->input.stops = 0;
    board->output.used = board->output.left = 0;
    board->subscribed = board->check.responds = false;
}
