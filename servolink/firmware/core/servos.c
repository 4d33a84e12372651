/* Servos: angles, movements, pulses. A hobby servo cannot say where it is, so one that has been limp moves softly at first. */

#include "state.h"

#define SOFT_DURATION 1000000U /* shortest first movement */
#define SPARSE_DURATION 500000U /* of it, until which only every fifth pulse is made */

uint32_t servos_named(const struct board *board, uint32_t id) {
    uint32_t all = (1U << board->settings->servos) - 1U;
    if (id == ALL_SERVOS) return all;
    return id >= 1 && id <= board->settings->servos ? 1U << (id - 1) : 0;
}

bool servo_allows(const struct board *board, uint32_t id, int16_t correction) {
    if (id < 1 || id > board->settings->servos) return false;
    const struct board_range *range = &board->settings->ranges[id - 1U];
    return range->least - correction >= INT16_MIN && range->greatest - correction <= INT16_MAX;
}

void servos_adjust(struct board *board) {
    for (uint32_t i = 0; i < BOARD_SERVOS; i++) board->servos[i].adjusted = 0;
    const struct record *parameters = record_current(board, SERVO_PARAMETERS, 0);
    if (!parameters) return;
    const uint8_t *content = record_content(parameters);
    for (uint32_t i = 0; i < get_u16(content); i++) {
        const uint8_t *parameter = content + 2 + 35 * i;
        int16_t correction = get_i16(parameter + 1);
        if (servo_allows(board, parameter[0], correction)) board->servos[parameter[0] - 1U].adjusted = correction;
    }
}

static int32_t clamp(int32_t value, int32_t one, int32_t other) {
    int32_t least = one < other ? one : other, greatest = one < other ? other : one;
    return value < least ? least : value > greatest ? greatest : value;
}

/* Pulse width for an angle of a request, in degrees or, as an ADC value, in microseconds. */
static int32_t pulse_of(const struct board *board, uint32_t index, int32_t value, bool is_adc) {
    const struct board_range *range = &board->settings->ranges[index];
    if (is_adc) return clamp(value, range->shortest, range->longest) * 1000;
    int32_t degrees = clamp(value + board->servos[index].adjusted, range->least, range->greatest) - range->least;
    int64_t width = (int64_t)(range->longest - range->shortest) * 1000 * degrees;
    return range->shortest * 1000 + (int32_t)(width / (range->greatest - range->least));
}

static int32_t pulse_now(const struct servo *servo, uint64_t now) {
    uint64_t elapsed = now > servo->start ? now - servo->start : 0;
    if (elapsed >= servo->duration) return servo->to;
    return servo->from + (int32_t)((servo->to - servo->from) * (int64_t)elapsed / (int64_t)servo->duration);
}

/* Angle of the moment, in the unit of the servo; 0 degrees while it is not known. */
int32_t servo_value(const struct board *board, uint32_t index) {
    const struct servo *servo = &board->servos[index];
    const struct board_range *range = &board->settings->ranges[index];
    int32_t pulse = servo->placed ? pulse_now(servo, board->now) : pulse_of(board, index, 0, false);
    if (servo->is_adc) return (pulse + 500) / 1000;
    int64_t width = (range->longest - range->shortest) * 1000;
    int64_t degrees = (int64_t)(pulse - range->shortest * 1000) * (range->greatest - range->least) * 2 / width;
    return (int32_t)((degrees + 1) / 2) + range->least - servo->adjusted;
}

static void show(struct board *board, uint32_t index, uint32_t pulse) {
    struct servo *servo = &board->servos[index];
    if (servo->shown != pulse) board->ports->pulse(board->ports->context, index, pulse);
    servo->shown = pulse;
}

void servo_set(struct board *board, uint32_t index, bool is_start, bool is_hold) {
    struct servo *servo = &board->servos[index];
    if (!is_hold) {
        servo->placed = false;
        show(board, index, 0);
    } else if (!is_start && servo->placed) {
        servo->from = servo->to = pulse_now(servo, board->now);
        servo->duration = 0;
        show(board, index, (uint32_t)servo->to);
    }
    servo->is_start = is_start;
    servo->is_hold = is_hold;
    for (uint32_t i = 0; i < BOARD_SERVOS; i++) {
        if (board->servos[i].is_start && board->servos[i].is_hold) return;
    }
    macro_end(board); /* nothing is left that it could move */
}

static void move(struct board *board, uint64_t start, uint32_t index, int32_t value, uint64_t duration) {
    struct servo *servo = &board->servos[index];
    if (!servo->is_start || !servo->is_hold) return;
    servo->from = servo->placed ? pulse_now(servo, start) : pulse_of(board, index, 0, false);
    servo->to = pulse_of(board, index, value, servo->is_adc);
    if (!servo->placed) servo->soft_until = start + SOFT_DURATION;
    servo->placed = true;
    servo->start = start;
    servo->duration = start + duration < servo->soft_until ? servo->soft_until - start : duration;
}

/* Begin the steps of an action together, the last one of each servo. `scale` stretches their intervals, in 1/65536. Returns
   the longest interval, in 10 ms, without that. */
uint32_t servos_move(struct board *board, uint64_t start, const uint8_t *steps, uint32_t count, uint32_t scale) {
    const uint8_t *of_servo[BOARD_SERVOS] = {NULL};
    uint32_t longest = 0;
    for (const uint8_t *step = steps; step < steps + 5 * count; step += 5) {
        uint32_t index = step[0] - 1U, interval = get_u16(step + 3);
        if (interval > longest) longest = interval;
        if (index < board->settings->servos) of_servo[index] = step;
    }
    for (uint32_t i = 0; i < BOARD_SERVOS; i++) {
        const uint8_t *step = of_servo[i];
        if (step) move(board, start, i, get_i16(step + 1), get_u16(step + 3) * UINT64_C(10000) * scale >> 16);
    }
    return longest;
}

void servos_period(struct board *board) {
    for (uint32_t i = 0; i < board->settings->servos; i++) {
        struct servo *servo = &board->servos[i];
        if (!servo->placed) continue;
        uint64_t soft = servo->soft_until > board->now ? servo->soft_until - board->now : 0;
        bool is_left_out = soft > SOFT_DURATION - SPARSE_DURATION && (uint32_t)soft / BOARD_PERIOD % 5U;
        show(board, i, is_left_out ? 0 : (uint32_t)pulse_now(servo, board->now));
    }
}
