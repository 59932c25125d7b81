// C functions of the virtual finger board, for rigctl/finger/bench/firmware.py.
#include "../export.h"
#include "finger_board.h"

#ifndef SOURCES
#error "say what the library is made of: -DSOURCES='\"…\"'"
#endif

EXPORT const char *finger_sources() { return SOURCES; }
EXPORT uint64_t finger_io_size() { return sizeof(FingerIO); }
EXPORT FingerBoard *finger_open() { return new FingerBoard(); }
EXPORT void finger_close(FingerBoard *board) { delete board; }
EXPORT FingerIO *finger_io(FingerBoard *board) { return &board->io; }
EXPORT void finger_run(FingerBoard *board, int32_t samples) { board->run(samples); }

EXPORT void finger_boot(FingerBoard *board, int32_t cause)
{
    board->boot(static_cast<uint8_t>(cause));
}

EXPORT void finger_receive_taxels(FingerBoard *board, const uint8_t *bytes, int32_t count)
{
    board->receive_taxels(bytes, count);
}

EXPORT void finger_receive(FingerBoard *board, const uint8_t *bytes, int32_t count)
{
    board->receive(bytes, count);
}
