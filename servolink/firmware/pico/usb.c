/* USB device with one serial port (CDC-ACM), without interrupts. It answers all standard requests of USB 2.0, chapter 9.4,
   that a device of one configuration at full speed has, and refuses the others.

   The ids are Raspberry Pi's for a serial port on an RP2040, which they let firmware share that has its own product string. */

#include "registers.h"

#include <string.h>

#define PACKET 64U
#define CONTROL_DATA 0x100U /* offset in the controller's memory, fixed by the hardware */
#define OUT_DATA 0x180U
#define IN_DATA 0x1c0U
#define NOTIFY_DATA 0x200U
#define FULL (1U << 15)
#define DATA1 (1U << 13)
#define STALL (1U << 11)
#define AVAILABLE (1U << 10)
#define BUFFER_CONTROL(endpoint, is_out) REG(USB_MEMORY + 0x80U + 8U * (endpoint) + 4U * (is_out))
#define ENDPOINT_CONTROL(endpoint, is_out) REG(USB_MEMORY + 8U * (endpoint) + 4U * (is_out))
#define SIE_STATUS (USB + 0x50U)
#define BUFFER_STATUS (USB + 0x58U)

#define BUS_RESET (1U << 19)
#define SETUP_RECEIVED (1U << 17)
#define RESUMED (1U << 11)
#define SUSPENDED (1U << 4) /* 3 ms without a frame of the host */
#define KEY(type, request) ((uint32_t)(type) << 8 | (request))

enum { CONTROL, NOTIFY, BULK };
enum { OF_DEVICE = 0x00, OF_INTERFACE = 0x01, OF_ENDPOINT = 0x02, CLASS = 0x20, TO_HOST = 0x80 }; /* bmRequestType */
enum {
    GET_STATUS = 0x00,
    CLEAR_FEATURE = 0x01,
    SET_FEATURE = 0x03,
    SET_ADDRESS = 0x05,
    GET_DESCRIPTOR = 0x06,
    GET_CONFIGURATION = 0x08,
    SET_CONFIGURATION = 0x09,
    GET_INTERFACE = 0x0a,
    SET_INTERFACE = 0x0b,
};
enum { SET_LINE_CODING = 0x20, GET_LINE_CODING = 0x21, SET_CONTROL_LINE_STATE = 0x22 };

static const uint8_t DEVICE[] = {18, 1, 0, 2, 2, 0, 0, PACKET, 0x8a, 0x2e, 0x0a, 0x00, 0, 1, 1, 2, 3, 1};
static const uint8_t CONFIGURATION[] = {
    9, 2, 67, 0, 2, 1, 0, 0x80, 50,            /* bus powered, 100 mA: servos have a supply of their own */
    9, 4, 0, 0, 1, 2, 2, 0, 0,                 /* interface 0: serial port, control */
    5, 0x24, 0, 0x10, 1,                       /* CDC 1.10 */
    5, 0x24, 1, 0, 1, 4, 0x24, 2, 2,           /* no calls; line coding and line state */
    5, 0x24, 6, 0, 1,                          /* interfaces 0 and 1 belong together */
    7, 5, 0x80 | NOTIFY, 3, 8, 0, 16,
    9, 4, 1, 0, 2, 10, 0, 0, 0,                /* interface 1: serial port, data */
    7, 5, BULK, 2, PACKET, 0, 0,
    7, 5, 0x80 | BULK, 2, PACKET, 0, 0,
};
static const char *const STRINGS[] = {"servolink", "servolink board"};

struct setup {
    uint32_t key; /* type and request */
    uint32_t value, index, wanted;
};

static struct {
    bool is_addressed;    /* the address is to be set, when the status of its request was sent */
    uint8_t address;
    const uint8_t *data;  /* rest of the response to a control request */
    uint32_t left;
    bool is_line_coding;  /* the host sends 7 bytes of it */
    bool is_configured, is_open, is_sending;
    bool has_packet;      /* bytes of the host wait until the board has room for them */
    bool ends_packet;     /* the last packet was full, so the host waits for more */
    bool had_power, is_asleep;
    bool is_used;         /* it is the line to the board */
    uint32_t frame;       /* number of the host's last frame */
    bool is_halted[3][2]; /* endpoint and direction */
    uint32_t next[3][2];  /* DATA0 or DATA1 of each endpoint and direction */
    uint8_t line_coding[7];
    uint8_t string[2 + 2 * 16];
    char serial[17];
} usb;

static void start_transfer(uint32_t endpoint, bool is_out, uint32_t size) {
    uint32_t control = size | usb.next[endpoint][is_out] | (is_out ? 0 : FULL);
    usb.next[endpoint][is_out] ^= DATA1;
    BUFFER_CONTROL(endpoint, is_out) = control;
    __asm volatile("nop\nnop\nnop\nnop\nnop\nnop"); /* the controller's clock must see the rest before AVAILABLE */
    BUFFER_CONTROL(endpoint, is_out) = control | AVAILABLE;
}

static void send(uint32_t endpoint, uint32_t offset, const uint8_t *data, uint32_t size) {
    volatile uint8_t *memory = (volatile uint8_t *)(uintptr_t)(USB_MEMORY + offset);
    for (uint32_t i = 0; i < size; i++) memory[i] = data[i];
    start_transfer(endpoint, false, size);
}

static void send_control(void) {
    uint32_t size = usb.left < PACKET ? usb.left : PACKET;
    send(CONTROL, CONTROL_DATA, usb.data, size);
    usb.data += size;
    usb.left -= size;
}

static void respond(const uint8_t *data, uint32_t size, uint32_t wanted) {
    usb.data = data;
    usb.left = size < wanted ? size : wanted;
    send_control();
}

static void refuse(void) {
    REG(USB + 0x68U) = 3; /* both directions of endpoint 0 */
    BUFFER_CONTROL(CONTROL, false) = STALL;
    BUFFER_CONTROL(CONTROL, true) = STALL;
}

static void respond_string(uint32_t index, uint32_t wanted) {
    static const uint8_t languages[] = {4, 3, 0x09, 0x04};
    if (index == 0) {
        respond(languages, sizeof languages, wanted);
        return;
    }
    const char *text = index == 3 ? usb.serial : STRINGS[index - 1];
    uint32_t length = (uint32_t)strlen(text);
    memset(usb.string, 0, sizeof usb.string);
    usb.string[0] = (uint8_t)(2 + 2 * length);
    usb.string[1] = 3;
    for (uint32_t i = 0; i < length; i++) usb.string[2 + 2 * i] = (uint8_t)text[i];
    respond(usb.string, usb.string[0], wanted);
}

static bool confirm(void) {
    respond(NULL, 0, 0);
    return true;
}

/* Begin again with DATA0, and what was under way. */
static void restart(uint32_t endpoint, bool is_out) {
    bool is_waiting = is_out ? !usb.has_packet : usb.is_sending;
    usb.next[endpoint][is_out] = 0;
    usb.is_halted[endpoint][is_out] = false;
    uint32_t size = is_out ? PACKET : BUFFER_CONTROL(endpoint, false) & 0x3ffU;
    BUFFER_CONTROL(endpoint, is_out) = 0;
    if (endpoint == BULK && is_waiting) start_transfer(BULK, is_out, size);
}

static void configure(bool is_configured) {
    usb.is_configured = is_configured;
    usb.is_open = usb.is_sending = usb.has_packet = usb.ends_packet = false;
    uint32_t enabled = is_configured ? 1U << 31 | 1U << 29 : 0;
    ENDPOINT_CONTROL(NOTIFY, false) = enabled ? enabled | 3U << 26 | NOTIFY_DATA : 0;
    ENDPOINT_CONTROL(BULK, false) = enabled ? enabled | 2U << 26 | IN_DATA : 0;
    ENDPOINT_CONTROL(BULK, true) = enabled ? enabled | 2U << 26 | OUT_DATA : 0;
    if (!is_configured) return;
    restart(NOTIFY, false);
    restart(BULK, false);
    restart(BULK, true);
}

static bool describe(uint32_t value, uint32_t wanted) {
    if (value == 0x100) {
        respond(DEVICE, sizeof DEVICE, wanted);
    } else if (value == 0x200) {
        respond(CONFIGURATION, sizeof CONFIGURATION, wanted);
    } else if (value >= 0x300 && value <= 0x303) {
        respond_string(value & 0xffU, wanted);
    } else {
        return false;
    }
    return true;
}

static bool answer(uint32_t value, uint32_t size, uint32_t wanted) {
    static uint8_t bytes[2];
    bytes[0] = (uint8_t)value;
    respond(bytes, size, wanted);
    return true;
}

/* Requests about an endpoint. The only feature is that it is halted, which endpoint 0 cannot be. */
static bool handle_endpoint(const struct setup *setup) {
    uint32_t endpoint = setup->index & 0x7fU;
    bool is_out = !(setup->index & 0x80U);
    bool is_there = endpoint == CONTROL || (usb.is_configured && (endpoint == BULK || (endpoint == NOTIFY && !is_out)));
    if (!is_there || setup->index > 0xffU || setup->value) return false;
    if (setup->key == KEY(TO_HOST | OF_ENDPOINT, GET_STATUS)) return answer(usb.is_halted[endpoint][is_out], 2, setup->wanted);
    if (setup->wanted) return false;
    if (setup->key == KEY(OF_ENDPOINT, CLEAR_FEATURE)) {
        if (endpoint != CONTROL) restart(endpoint, is_out);
        return confirm();
    }
    if (setup->key != KEY(OF_ENDPOINT, SET_FEATURE) || endpoint == CONTROL) return false;
    usb.is_halted[endpoint][is_out] = true;
    BUFFER_CONTROL(endpoint, is_out) = (BUFFER_CONTROL(endpoint, is_out) & 0x3ffU) | STALL;
    return confirm();
}

static bool handle_interface(const struct setup *setup) {
    if (!usb.is_configured || setup->index > 1U || setup->value) return false;
    switch (setup->key) {
    case KEY(TO_HOST | OF_INTERFACE, GET_STATUS): return answer(0, 2, setup->wanted);
    case KEY(TO_HOST | OF_INTERFACE, GET_INTERFACE): return answer(0, 1, setup->wanted);
    case KEY(OF_INTERFACE, SET_INTERFACE): break; /* to the only setting */
    default: return false;
    }
    if (setup->wanted) return false;
    restart(setup->index ? BULK : NOTIFY, false);
    if (setup->index) restart(BULK, true);
    return confirm();
}

static bool handle_device(const struct setup *setup) {
    uint32_t value = setup->value, wanted = setup->wanted;
    switch (setup->key) {
    case KEY(TO_HOST | OF_DEVICE, GET_DESCRIPTOR): return describe(value, wanted); /* the index is a language then */
    case KEY(TO_HOST | OF_DEVICE, GET_STATUS): return !value && !setup->index && answer(0, 2, wanted);
    case KEY(TO_HOST | OF_DEVICE, GET_CONFIGURATION):
        return !value && !setup->index && answer(usb.is_configured, 1, wanted);
    case KEY(OF_DEVICE, SET_ADDRESS):
        if (value > 127U || setup->index || wanted) return false;
        usb.address = (uint8_t)value;
        usb.is_addressed = true;
        return confirm();
    case KEY(OF_DEVICE, SET_CONFIGURATION):
        if (value > 1U || setup->index || wanted) return false;
        configure(value);
        return confirm();
    default: return false;
    }
}

/* Requests of serial ports are for interface 0; some hosts name the device. */
static bool handle_class(const struct setup *setup) {
    if (!usb.is_configured || setup->index) return false;
    switch (setup->key & ~KEY(OF_INTERFACE, 0)) {
    case KEY(TO_HOST | CLASS, GET_LINE_CODING):
        respond(usb.line_coding, sizeof usb.line_coding, setup->wanted);
        return true;
    case KEY(CLASS, SET_LINE_CODING):
        if (setup->wanted != sizeof usb.line_coding) return false;
        usb.is_line_coding = true;
        start_transfer(CONTROL, true, PACKET);
        return true;
    case KEY(CLASS, SET_CONTROL_LINE_STATE):
        if (setup->wanted) return false;
        usb.is_open = setup->value & 1U; /* DTR */
        return confirm();
    default: return false;
    }
}

static void handle_setup(void) {
    uint32_t words[2] = {REG(USB_MEMORY), REG(USB_MEMORY + 4U)};
    uint32_t type = words[0] & 0xffU;
    struct setup setup = {KEY(type, words[0] >> 8 & 0xffU), words[0] >> 16, words[1] & 0xffffU, words[1] >> 16};
    usb.next[CONTROL][false] = usb.next[CONTROL][true] = DATA1;
    usb.left = 0;
    usb.data = NULL;
    usb.is_line_coding = usb.is_addressed = false;
    bool is_done = false;
    if ((type & 0x7eU) == CLASS) {
        is_done = handle_class(&setup);
    } else if ((type & 0x7fU) == OF_DEVICE) {
        is_done = handle_device(&setup);
    } else if ((type & 0x7fU) == OF_INTERFACE) {
        is_done = handle_interface(&setup);
    } else if ((type & 0x7fU) == OF_ENDPOINT) {
        is_done = handle_endpoint(&setup);
    }
    if (!is_done) refuse();
}

/* Endpoint 0: what was sent may go on; what was received is a line coding, or the end of a request. */
static void handle_control(bool is_out) {
    if (!is_out) {
        if (usb.is_addressed) REG(USB) = usb.address;
        usb.is_addressed = false;
        if (usb.left) {
            send_control();
        } else if (usb.data) {
            usb.data = NULL;
            start_transfer(CONTROL, true, 0);
        }
    } else if (usb.is_line_coding) {
        usb.is_line_coding = false;
        memcpy(usb.line_coding, (const void *)(uintptr_t)(USB_MEMORY + CONTROL_DATA), sizeof usb.line_coding);
        respond(NULL, 0, 0);
    }
}

void usb_start(void) {
    uint8_t id[8];
    flash_id(id);
    for (int i = 0; i < 16; i++) usb.serial[i] = "0123456789ABCDEF"[id[i / 2] >> (i % 2 ? 0 : 4) & 15];
    for (uint32_t offset = 0; offset < 0x200; offset += 4) REG(USB_MEMORY + offset) = 0;
    REG(USB + 0x74U) = 1U << 3 | 1U;       /* controller to the transceiver */
    REG(USB + 0x78U) = 1U << 3 | 1U << 2;  /* there is power from the host, as far as the controller is to know */
    REG(USB + 0x40U) = 1;                  /* on, as a device */
    REG(USB + 0x4cU) = 1U << 29 | 1U << 16; /* tell of each packet of endpoint 0, and pull up: be there */
}

static void detach(void) {
    REG(USB) = 0;
    configure(false);
}

/* Follow the cable and the host: reset, pulled out, asleep or switched off. A Pico W cannot sense the cable: its pin is low
   always. */
static void follow_host(uint32_t status) {
    bool has_power = REG(SIO + 4U) >> VBUS_PIN & 1U;
    uint32_t frame = REG(USB + 0x48U);
    if (status & BUS_RESET || (usb.had_power && !has_power)) detach();
    if (status & (BUS_RESET | SETUP_RECEIVED | RESUMED) || frame != usb.frame) usb.is_asleep = false;
    if (status & SUSPENDED) usb.is_asleep = true;
    usb.had_power = has_power;
    usb.frame = frame;
    REG(SIE_STATUS) = status & (BUS_RESET | RESUMED | SUSPENDED);
}

static void follow_transfers(uint32_t status) {
    uint32_t done = REG(BUFFER_STATUS);
    REG(BUFFER_STATUS) = done;
    if (done & 1U << (2 * BULK)) usb.is_sending = false;
    if (done & 2U << (2 * BULK)) {
        usb.has_packet = true;
        if (!(status & SUSPENDED) && BUFFER_CONTROL(BULK, true) & 0x3ffU) usb.is_asleep = false;
    }
    if (done & 1U) handle_control(false);
    if (done & 2U) handle_control(true);
    if (status & SETUP_RECEIVED) {
        REG(SIE_STATUS) = SETUP_RECEIVED;
        handle_setup();
    }
}

/* Give the board a packet of the host, when there is room. One that comes while no program has the port open is dropped. */
static void receive(struct board *board, uint64_t now) {
    uint8_t bytes[PACKET];
    uint32_t size = BUFFER_CONTROL(BULK, true) & 0x3ffU;
    if (!usb.is_used || size > PACKET) size = 0;
    if (size > board_room(board)) return;
    memcpy(bytes, (const void *)(uintptr_t)(USB_MEMORY + OUT_DATA), PACKET);
    usb.has_packet = false;
    if (!usb.is_halted[BULK][true]) start_transfer(BULK, true, PACKET);
    if (size) board_receive(board, now, bytes, size);
}

static void transmit(struct board *board) {
    uint8_t bytes[PACKET];
    uint32_t size = (uint32_t)board_transmit(board, bytes, PACKET);
    if (!size && !usb.ends_packet) return;
    usb.is_sending = true;
    usb.ends_packet = size == PACKET;
    send(BULK, IN_DATA, bytes, size);
}

bool usb_poll(struct board *board, uint64_t now) {
    uint32_t status = REG(SIE_STATUS);
    follow_host(status);
    follow_transfers(status);
    bool is_used = usb.is_configured && usb.is_open && !usb.is_asleep;
    if (is_used != usb.is_used) board_detach(board);
    usb.is_used = is_used;
    if (!usb.is_configured) return false;
    if (usb.has_packet) receive(board, now);
    if (is_used && !usb.is_sending && !usb.is_halted[BULK][false]) transmit(board);
    return is_used;
}
