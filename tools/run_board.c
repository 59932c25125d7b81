/* Run a board for a second, and write its inputs and outputs: run_board LIBRARY BOARD REQUEST.
   The drum gets the request, in hexadecimal digits, so that there is a reply to compare.
   `make wheels` compiles it for other systems and compares what it writes with this computer's. */
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#ifdef _WIN32
#include <fcntl.h>
#include <io.h>
#include <windows.h>
#define OPEN(path) ((void *)LoadLibraryA(path))
#define FIND(library, name) ((void *)GetProcAddress((HMODULE)(library), name))
#else
#include <dlfcn.h>
#define OPEN(path) dlopen(path, RTLD_NOW)
#define FIND(library, name) dlsym(library, name)
#endif

static void *library;
static const char *board;

static void *function(const char *name) {
    char whole[64];
    snprintf(whole, sizeof whole, "%s_%s", board, name);
    return FIND(library, whole);
}

static void run_drum(void *handle, const char *digits) {
    uint8_t request[64];
    int32_t size = 0;
    for (unsigned byte; size < 64 && sscanf(digits + 2 * size, "%2x", &byte) == 1; size++)
        request[size] = (uint8_t)byte;
    void (*run)(void *, int64_t) = (void (*)(void *, int64_t))function("run");
    run(handle, 8000000);
    ((void (*)(void *, const uint8_t *, int32_t, int64_t))function("receive"))(
        handle, request, size, 8000000);
    run(handle, 16000000);
}

static void run_taxels(void *handle) {
    uint16_t readings[100 * 18];
    for (int32_t i = 0; i < 100 * 18; i++)
        readings[i] = (uint16_t)(i * 7 % 1024);
    ((void (*)(void *, const uint16_t *, int32_t))function("run"))(handle, readings, 100);
}

int main(int count, char **words) {
    if (count != 4 || !(library = OPEN(words[1])))
        return 1;
    board = words[2];
    void *handle = ((void *(*)(void))function("open"))();
    char *io = ((char *(*)(void *))function("io"))(handle);
    ((void (*)(void *, int32_t))function("boot"))(handle, 1);
    if (!strcmp(board, "taxels"))
        run_taxels(handle);
    else if (!strcmp(board, "drum"))
        run_drum(handle, words[3]);
    else
        ((void (*)(void *, int32_t))function("run"))(handle, 1000);
    uint64_t size = ((uint64_t (*)(void))function("io_size"))();
#ifdef _WIN32
    _setmode(_fileno(stdout), _O_BINARY);
#endif
    return fwrite(io, 1, size, stdout) != size;
}
