/* Board on a Raspberry Pi Pico: pulses on GPIO 0 to 15, UART on 16 and 17, battery on 26, buttons on the others. */

#include "../core/state.h"
#include "registers.h"

#define PULSE_FUNCTION 4U
#define UART_FUNCTION 2U
#define BATTERY_PIN 26U
#define WATCHDOG_LOAD (2U * 200000U) /* 200 ms, as it counts two in each microsecond */

static const uint8_t BUTTON_PINS[BOARD_BUTTONS] = {18, 19, 20, 21, 22, 27, 28, 17};

/* Neither const nor static: the compiler would put these values into the code, and the installation changes them here. */
__attribute__((section(".settings"))) struct board_settings settings = {
    BOARD_SETTINGS_MAGIC, BOARD_SERVOS, BOARD_BUTTONS - 1, 0, 0, 0,
    {BOARD_RANGE, BOARD_RANGE, BOARD_RANGE, BOARD_RANGE, BOARD_RANGE, BOARD_RANGE, BOARD_RANGE, BOARD_RANGE,
     BOARD_RANGE, BOARD_RANGE, BOARD_RANGE, BOARD_RANGE, BOARD_RANGE, BOARD_RANGE, BOARD_RANGE, BOARD_RANGE},
};

static struct board board;

/* Bytes of the UART, which an interrupt puts here while the core does something longer. */
static volatile uint8_t received[1024];
static volatile uint32_t received_head, received_tail;

static void pulse(void *context, unsigned servo, uint32_t nanoseconds) {
    uint32_t compare = PWM + 0x14U * (servo / 2U) + 0x0cU, shift = 16U * (servo % 2U);
    uint32_t width = (nanoseconds * 2U + 312U) / 625U; /* at 3.2 MHz */
    REG(compare) = (REG(compare) & ~(0xffffU << shift)) | width << shift;
}

static uint32_t battery(void *context) {
    SET(ADC) = 1U << 2;
    while (!(REG(ADC) & 1U << 8)) {}
    return REG(ADC + 4U) * 9900U >> 12; /* a third of the voltage, of 3.3 V */
}

static uint32_t buttons(void *context) {
    uint32_t levels = REG(SIO + 4U), pressed = 0;
    for (uint32_t i = 0; i < settings.buttons; i++) pressed |= (~levels >> BUTTON_PINS[i] & 1U) << i;
    return pressed;
}

static void alive(void *context) { REG(WATCHDOG + 4U) = WATCHDOG_LOAD; }

static const struct board_ports ports = {NULL, pulse, FLASH_SIZE, flash_erase, flash_program, flash_busy, flash_read,
                                         battery, buttons, alive};

static uint64_t microseconds(void) {
    for (;;) {
        uint32_t high = REG(TIMER + 0x24U), low = REG(TIMER + 0x28U);
        if (high == REG(TIMER + 0x24U)) return (uint64_t)high << 32 | low;
    }
}

/* All clocks have 48 MHz, from the crystal by the PLL for USB; the timer has 1 MHz. */
static void start_clocks(void) {
    REG(XOSC + 0x0cU) = 47;
    REG(XOSC) = 0xfabU << 12 | 0xaa0U;
    while (!(REG(XOSC + 4U) >> 31)) {}
    REG(CLOCKS + 0x30U) = 2;
    while (!(REG(CLOCKS + 0x38U) & 4U)) {}
    CLEAR(RESETS) = 1U << 13;
    while (!(REG(RESETS + 8U) & 1U << 13)) {}
    REG(PLL_USB) = 1;
    REG(PLL_USB + 8U) = 100;
    CLEAR(PLL_USB + 4U) = 1U << 5 | 1U;
    while (!(REG(PLL_USB) >> 31)) {}
    REG(PLL_USB + 0x0cU) = 5U << 16 | 5U << 12;
    CLEAR(PLL_USB + 4U) = 1U << 3;
    REG(CLOCKS + 0x3cU) = 1U << 5;
    REG(CLOCKS + 0x3cU) = 1U << 5 | 1U;
    while (!(REG(CLOCKS + 0x44U) & 2U)) {}
    REG(CLOCKS + 0x48U) = 1U << 11;
    REG(CLOCKS + 0x54U) = 1U << 11;
    REG(CLOCKS + 0x60U) = 1U << 11;
    REG(WATCHDOG + 0x2cU) = 1U << 9 | 12U;
}

static void start_pins(void) {
    uint32_t used = 1U << 0 | 1U << 5 | 1U << 8 | 1U << 14 | 1U << 21 | 1U << 22 | 1U << 24; /* ADC, IO, pads, PWM, timer, ... */
    CLEAR(RESETS) = used;
    while ((REG(RESETS + 8U) & used) != used) {}
    for (uint32_t channel = 0; channel < 8; channel++) {
        REG(PWM + 0x14U * channel + 4U) = 15U << 4; /* 3.2 MHz */
        REG(PWM + 0x14U * channel + 0x10U) = 63999; /* 20 ms */
    }
    REG(PWM + 0xa0U) = 0xff;
    for (uint32_t pin = 0; pin < BOARD_SERVOS; pin++) REG(IO_BANK0 + 8U * pin + 4U) = PULSE_FUNCTION;
    for (uint32_t i = 0; i < settings.buttons; i++) REG(PADS_BANK0 + 4U + 4U * BUTTON_PINS[i]) = 0x4a; /* pulled up */
    REG(PADS_BANK0 + 4U + 4U * BATTERY_PIN) = 0x80; /* analog */
    REG(PADS_BANK0 + 4U + 4U * VBUS_PIN) = 0x46; /* pulled down, as nothing drives it on a Pico W */
    REG(ADC) = 1;
}

static void start_uart(void) {
    REG(UART0 + 0x24U) = 26; /* 115,200 baud: 48 MHz / 16 / 26.04 */
    REG(UART0 + 0x28U) = 3;
    REG(UART0 + 0x2cU) = 3U << 5 | 1U << 4;
    REG(UART0 + 0x30U) = 1U << 9 | 1U << 8 | 1U;
    REG(UART0 + 0x38U) = 1U << 6 | 1U << 4;
    REG(IO_BANK0 + 8U * 16U + 4U) = UART_FUNCTION;
    REG(IO_BANK0 + 8U * 17U + 4U) = UART_FUNCTION;
    REG(NVIC) = 1U << 20;
}

static void uart_interrupt(void) {
    while (!(REG(UART0 + 0x18U) & 1U << 4)) {
        uint8_t byte = (uint8_t)REG(UART0);
        if (received_tail - received_head < sizeof received) received[received_tail++ % sizeof received] = byte;
    }
    REG(UART0 + 0x44U) = 1U << 6 | 1U << 4;
}

static void serve_uart(bool is_used, uint64_t now) {
    static uint8_t bytes[sizeof received];
    uint32_t size = 0, most = sizeof bytes; /* all that came in the last turn: the next one may take long too */
    if (is_used && board_room(&board) < most) most = board_room(&board);
    while (size < most && received_head != received_tail) bytes[size++] = received[received_head++ % sizeof received];
    if (!is_used) return;
    if (size) board_receive(&board, now, bytes, size);
    while (!(REG(UART0 + 0x18U) & 1U << 5) && board_transmit(&board, bytes, 1)) REG(UART0) = bytes[0];
}

static void serve(void) {
    for (;;) {
        uint64_t now = microseconds();
        bool is_usb = usb_poll(&board, now);
        if (settings.buttons < BOARD_BUTTONS) serve_uart(!is_usb, now);
        board_tick(&board, now);
    }
}

void start(void) {
    extern uint32_t bss_start[], bss_end[];
    /* cppcheck-suppress comparePointers ; ends of a section, set by the linker */
    for (uint32_t *word = bss_start; word < bss_end; word++) *word = 0;
    start_clocks();
    start_pins();
    if (settings.buttons < BOARD_BUTTONS) start_uart();
    flash_start();
    usb_start();
    while (REG(PWM + 8U) / 1000U != 48U) {} /* so that periods begin 5 ms before the pulses */
    board_start(&board, &settings, &ports, microseconds());
    REG(PSM + 8U) = 0x1fffc; /* the watchdog resets all but the oscillators */
    alive(NULL);
    SET(WATCHDOG) = 1U << 30;
    serve();
}

/* Anything unexpected waits here for the watchdog. */
static void hang(void) {
    for (;;) {}
}

extern uint32_t stack_top[];
__attribute__((section(".vectors"), used)) static void (*const vectors[16 + 32])(void) = {
    (void (*)(void))stack_top, start, hang, hang, hang, hang, hang, hang, hang, hang, hang, hang, hang, hang, hang, hang,
    [16 + 20] = uart_interrupt,
};
