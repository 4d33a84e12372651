/* Board as a process: on a TCP port, or on a pseudo-terminal whose path it prints. Its flash is a file.

   board tcp|pty FLASH [PORT] */

#define _GNU_SOURCE
#include "hardware.h"

#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

static void must(bool is_done, const char *name) {
    if (is_done) return;
    perror(name);
    exit(1);
}

static uint64_t microseconds(void) {
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (uint64_t)time.tv_sec * 1000000U + (uint64_t)time.tv_nsec / 1000U;
}

static uint8_t *open_flash(const char *path) {
    int file = open(path, O_RDWR | O_CREAT, 0600);
    must(file >= 0, path);
    off_t size = lseek(file, 0, SEEK_END);
    must(size >= 0 && ftruncate(file, FLASH_SIZE) == 0, path);
    uint8_t *flash = mmap(NULL, FLASH_SIZE, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    must(flash != MAP_FAILED, path);
    if (size < (off_t)FLASH_SIZE) memset(flash + size, 0xff, (size_t)(FLASH_SIZE - size));
    return flash;
}

static int open_pty(void) {
    int line = posix_openpt(O_RDWR | O_NOCTTY);
    must(line >= 0 && grantpt(line) == 0 && unlockpt(line) == 0, "pty");
    int other = open(ptsname(line), O_RDWR | O_NOCTTY); /* stays open, so that the line does not end with its host */
    struct termios mode;
    must(other >= 0 && tcgetattr(other, &mode) == 0, "pty");
    cfmakeraw(&mode);
    must(tcsetattr(other, TCSANOW, &mode) == 0, "pty");
    printf("%s\n", ptsname(line));
    return line;
}

static int listen_tcp(int port) {
    int listener = socket(AF_INET, SOCK_STREAM, 0), on = 1;
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_port = htons((uint16_t)port)};
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    must(listener >= 0 && setsockopt(listener, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on) == 0, "socket");
    must(bind(listener, (struct sockaddr *)&address, size) == 0 && listen(listener, 1) == 0, "port");
    must(getsockname(listener, (struct sockaddr *)&address, &size) == 0, "port");
    printf("tcp://127.0.0.1:%d\n", ntohs(address.sin_port));
    return listener;
}

/* Serve what the line has; false: the host has gone. */
static bool serve(struct hardware *hardware, int line) {
    uint8_t bytes[4096];
    ssize_t size = read(line, bytes, sizeof bytes);
    if (size <= 0) return false;
    hardware_receive(hardware, bytes, (size_t)size);
    return true;
}

int main(int count, char **arguments) {
    must(count >= 3, "board tcp|pty FLASH [PORT]");
    bool is_tcp = strcmp(arguments[1], "tcp") == 0;
    struct hardware *hardware = hardware_new(open_flash(arguments[2]));
    int listener = is_tcp ? listen_tcp(count > 3 ? atoi(arguments[3]) : 0) : -1;
    int line = is_tcp ? -1 : open_pty(), on = 1;
    fflush(stdout);
    hardware->now = microseconds();
    hardware_start(hardware);
    uint8_t bytes[1024];
    size_t from = 0, to = 0;
    for (;;) {
        hardware->now = microseconds();
        hardware_tick(hardware);
        if (from == to && line >= 0) from = 0, to = hardware_transmit(hardware, bytes, sizeof bytes);
        struct pollfd waited = {line >= 0 ? line : listener, (short)(POLLIN | (from < to ? POLLOUT : 0)), 0};
        poll(&waited, 1, 1);
        hardware->now = microseconds();
        bool is_there = true;
        if (line < 0) {
            if (waited.revents & POLLIN) {
                line = accept4(listener, NULL, NULL, SOCK_NONBLOCK);
                setsockopt(line, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
            }
            continue;
        }
        if (waited.revents & (POLLIN | POLLHUP | POLLERR)) is_there = serve(hardware, line);
        if (is_there && waited.revents & POLLOUT) {
            ssize_t size = write(line, bytes + from, to - from);
            from += size > 0 ? (size_t)size : 0;
        }
        if (!is_there && is_tcp) {
            board_detach(hardware->board);
            close(line);
            line = -1;
            from = to = 0;
        }
    }
}
