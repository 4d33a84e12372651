/* Answers requests on a descriptor; ends when the descriptor does.
     responder DESCRIPTOR SIZE HEX       every SIZE bytes (0: every line) with the same bytes
     responder DESCRIPTOR ID=HEX ...     every frame with the bytes for its packet id, an unknown one not at all
   RESPONDER_DELAY in the environment is the time before each response, in microseconds. */
#define _DEFAULT_SOURCE
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { HEADER = 8, OVERHEAD = 9, MOST = 32 };

struct answer { unsigned id; size_t size; unsigned char *bytes; };

static struct answer answers[MOST];
static int known;

static int add(unsigned id, const char *hex) {
    struct answer *new = &answers[known++];
    new->id = id, new->size = strlen(hex) / 2, new->bytes = malloc(new->size + 1);
    for (size_t at = 0; at < new->size; at++) {
        unsigned value;
        if (sscanf(hex + 2 * at, "%2x", &value) != 1) return 0;
        new->bytes[at] = (unsigned char)value;
    }
    return 1;
}

static unsigned delay;

static int respond(int line, const struct answer *answer) {
    if (delay) usleep(delay);
    for (size_t sent = 0; sent < answer->size;) {
        ssize_t size = write(line, answer->bytes + sent, answer->size - sent);
        if (size <= 0) return 0;
        sent += (size_t)size;
    }
    return 1;
}

/* Answer the frames in `data`; return how many bytes of it they were, or -1. */
static ssize_t frames(int line, const unsigned char *data, size_t size) {
    size_t at = 0;
    while (size - at >= HEADER) {
        size_t length = OVERHEAD + data[at + 6] + 256u * data[at + 7];
        if (size - at < length) break;
        unsigned id = data[at + 4] + 256u * data[at + 5];
        for (int each = 0; each < known; each++)
            if (answers[each].id == id && !respond(line, &answers[each])) return -1;
        at += length;
    }
    return (ssize_t)at;
}

/* Answer every `unit` bytes, or with 0 every line; likewise. */
static ssize_t pieces(int line, const unsigned char *data, size_t size, size_t unit) {
    size_t at = 0;
    for (;;) {
        const unsigned char *end = unit ? data + at + unit : memchr(data + at, '\n', size - at);
        if (unit ? size - at < unit : end == NULL) return (ssize_t)at;
        at = (size_t)(end - data) + (unit ? 0 : 1);
        if (!respond(line, &answers[0])) return -1;
    }
}

int main(int count, char **given) {
    static unsigned char held[1 << 17];
    if (count < 3 || count - 2 > MOST) return 2;
    if (getenv("RESPONDER_DELAY") != NULL) delay = (unsigned)atoi(getenv("RESPONDER_DELAY"));
    int line = atoi(given[1]), framed = strchr(given[2], '=') != NULL;
    if (!framed && (count != 4 || !add(0, given[3]))) return 2;
    for (int at = 2; framed && at < count; at++) {
        char *hex = strchr(given[at], '=');
        if (hex == NULL || !add((unsigned)atoi(given[at]), hex + 1)) return 2;
    }
    for (size_t size = 0;;) {
        ssize_t came = read(line, held + size, sizeof held - size);
        if (came <= 0) return 0;
        size += (size_t)came;
        ssize_t used = framed ? frames(line, held, size) : pieces(line, held, size, (size_t)atoi(given[2]));
        if (used < 0) return 1;
        size -= (size_t)used;
        memmove(held, held + used, size);
    }
}
