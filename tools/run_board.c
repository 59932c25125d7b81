/* Run a board for a second, and write its inputs and outputs: run_board LIBRARY BOARD.
   `make wheels` compiles it for Windows and compares what it writes with this computer's. */
#include <fcntl.h>
#include <io.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <windows.h>

static HMODULE library;
static const char *board;

static void *function(const char *name) {
    char whole[64];
    snprintf(whole, sizeof whole, "%s_%s", board, name);
    return (void *)GetProcAddress(library, whole);
}

int main(int count, char **words) {
    if (count != 3 || !(library = LoadLibraryA(words[1])))
        return 1;
    board = words[2];
    void *handle = ((void *(*)(void))function("open"))();
    char *io = ((char *(*)(void *))function("io"))(handle);
    ((void (*)(void *, int32_t))function("boot"))(handle, 1);
    void *run = function("run");
    uint16_t readings[100 * 18];
    for (int32_t i = 0; i < 100 * 18; i++)
        readings[i] = (uint16_t)(i * 7 % 1024);
    if (!strcmp(board, "taxels"))
        ((void (*)(void *, const uint16_t *, int32_t))run)(handle, readings, 100);
    else if (!strcmp(board, "drum"))
        ((void (*)(void *, int64_t))run)(handle, 16000000);
    else
        ((void (*)(void *, int32_t))run)(handle, 1000);
    uint64_t size = ((uint64_t (*)(void))function("io_size"))();
    _setmode(_fileno(stdout), _O_BINARY);
    return fwrite(io, 1, size, stdout) != size;
}
