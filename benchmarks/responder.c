/* Answers every request on a descriptor with the same bytes: responder DESCRIPTOR REQUEST_SIZE ANSWER_IN_HEX.
   A REQUEST_SIZE of 0 means that requests are lines. Ends when the descriptor does. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

int main(int count, char **given) {
    if (count != 4) return 2;
    int line = atoi(given[1]);
    size_t request_size = (size_t)atoi(given[2]), answer_size = strlen(given[3]) / 2, waiting = 0;
    unsigned char *answer = malloc(answer_size + 1), came[4096];
    for (size_t at = 0; at < answer_size; at++) {
        unsigned value;
        if (sscanf(given[3] + 2 * at, "%2x", &value) != 1) return 2;
        answer[at] = (unsigned char)value;
    }
    for (;;) {
        ssize_t size = read(line, came, sizeof came);
        if (size <= 0) return 0;
        if (request_size) {
            waiting += (size_t)size;
        } else {
            for (ssize_t at = 0; at < size; at++) waiting += came[at] == '\n';
        }
        for (size_t unit = request_size ? request_size : 1; waiting >= unit; waiting -= unit)
            if (write(line, answer, answer_size) != (ssize_t)answer_size) return 1;
    }
}
