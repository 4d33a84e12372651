/* USB device with one serial port (CDC-ACM), without interrupts.

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

enum { CONTROL, NOTIFY, BULK };
enum { SET_ADDRESS = 0x05, GET_DESCRIPTOR = 0x06, SET_CONFIGURATION = 0x09 };
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

static struct {
    uint8_t address;      /* to be set when the status of its request was sent */
    const uint8_t *data;  /* rest of the response to a control request */
    uint32_t left;
    bool is_line_coding;  /* the host sends 7 bytes of it */
    bool is_configured, is_open, is_sending;
    bool ends_packet;     /* the last packet was full, so the host waits for more */
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

static void configure(void) {
    usb.is_configured = true;
    usb.is_open = usb.is_sending = usb.ends_packet = false;
    memset(usb.next[NOTIFY], 0, sizeof usb.next[NOTIFY]);
    memset(usb.next[BULK], 0, sizeof usb.next[BULK]);
    ENDPOINT_CONTROL(NOTIFY, false) = 1U << 31 | 1U << 29 | 3U << 26 | NOTIFY_DATA;
    ENDPOINT_CONTROL(BULK, false) = 1U << 31 | 1U << 29 | 2U << 26 | IN_DATA;
    ENDPOINT_CONTROL(BULK, true) = 1U << 31 | 1U << 29 | 2U << 26 | OUT_DATA;
    start_transfer(BULK, true, PACKET);
}

static void handle_setup(void) {
    uint32_t words[2] = {REG(USB_MEMORY), REG(USB_MEMORY + 4U)};
    uint32_t request = words[0] >> 8 & 0xffU, value = words[0] >> 16, wanted = words[1] >> 16;
    usb.next[CONTROL][false] = usb.next[CONTROL][true] = DATA1;
    usb.left = 0;
    if (request == GET_DESCRIPTOR && value == 0x100) {
        respond(DEVICE, sizeof DEVICE, wanted);
    } else if (request == GET_DESCRIPTOR && value == 0x200) {
        respond(CONFIGURATION, sizeof CONFIGURATION, wanted);
    } else if (request == GET_DESCRIPTOR && value >= 0x300 && value <= 0x303) {
        respond_string(value & 0xffU, wanted);
    } else if (request == GET_LINE_CODING) {
        respond(usb.line_coding, sizeof usb.line_coding, wanted);
    } else if (request == SET_LINE_CODING) {
        usb.is_line_coding = true;
        start_transfer(CONTROL, true, PACKET);
    } else if (request == SET_ADDRESS || request == SET_CONFIGURATION || request == SET_CONTROL_LINE_STATE) {
        if (request == SET_ADDRESS) usb.address = (uint8_t)value;
        if (request == SET_CONFIGURATION) configure();
        if (request == SET_CONTROL_LINE_STATE) usb.is_open = value & 1U; /* DTR */
        respond(NULL, 0, 0);
    } else {
        refuse();
    }
}

/* Endpoint 0: what was sent may go on; what was received is a line coding, or the end of a request. */
static void handle_control(bool is_out) {
    if (!is_out) {
        if (usb.address) REG(USB) = usb.address;
        usb.address = 0;
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
    REG(USB + 0x78U) = 1U << 3 | 1U << 2;  /* there is power from the host, as the Pico has no pin to ask */
    REG(USB + 0x40U) = 1;                  /* on, as a device */
    REG(USB + 0x4cU) = 1U << 29 | 1U << 16; /* tell of each packet of endpoint 0, and pull up: be there */
}

bool usb_poll(struct board *board, uint64_t now) {
    uint32_t status = REG(SIE_STATUS), done = REG(BUFFER_STATUS);
    if (status & 1U << 19) { /* the bus was reset */
        REG(SIE_STATUS) = 1U << 19;
        REG(USB) = 0;
        usb.is_configured = usb.is_open = false;
    }
    REG(BUFFER_STATUS) = done;
    if (done & 1U) handle_control(false);
    if (done & 2U) handle_control(true);
    if (status & 1U << 17) {
        REG(SIE_STATUS) = 1U << 17;
        handle_setup();
    }
    if (!usb.is_configured) return false;
    if (done & 1U << (2 * BULK)) usb.is_sending = false;
    if (done & 2U << (2 * BULK)) {
        uint8_t bytes[PACKET];
        uint32_t size = BUFFER_CONTROL(BULK, true) & 0x3ffU;
        memcpy(bytes, (const void *)(uintptr_t)(USB_MEMORY + OUT_DATA), PACKET);
        start_transfer(BULK, true, PACKET);
        if (usb.is_open && size <= PACKET) board_receive(board, now, bytes, size);
    }
    if (usb.is_open && !usb.is_sending) {
        uint8_t bytes[PACKET];
        uint32_t size = (uint32_t)board_transmit(board, bytes, PACKET);
        if (size || usb.ends_packet) {
            usb.is_sending = true;
            usb.ends_packet = size == PACKET;
            send(BULK, IN_DATA, bytes, size);
        }
    }
    return usb.is_open;
}
