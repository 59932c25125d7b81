// C functions of the virtual taxel board, for rigctl/bench/boards/taxels.py.
#include "../export.h"
#include "taxel_board.h"

#ifndef SOURCES
#error "say what the library is made of: -DSOURCES='\"…\"'"
#endif

EXPORT const char *taxels_sources() { return SOURCES; }
EXPORT uint64_t taxels_io_size() { return sizeof(TaxelIO); }
EXPORT TaxelBoard *taxels_open() { return new TaxelBoard(); }
EXPORT void taxels_close(TaxelBoard *board) { delete board; }
EXPORT TaxelIO *taxels_io(TaxelBoard *board) { return &board->io; }
EXPORT int32_t taxels_lines() { return LINES; }
EXPORT int32_t taxels_inputs() { return INPUTS; }
EXPORT void taxels_close_frames(TaxelBoard *board, int32_t frames) { board->close(frames); }

EXPORT void taxels_run(TaxelBoard *board, const uint16_t *readings, int32_t frames)
{
    board->run(readings, frames);
}

EXPORT void taxels_boot(TaxelBoard *board, int32_t cause)
{
    board->boot(static_cast<uint8_t>(cause));
}

EXPORT void taxels_edge(TaxelBoard *board, int32_t signal, int32_t level, int64_t cycle)
{
    board->edge(static_cast<EdgeOf>(signal), level != 0, cycle > 0 ? uint64_t(cycle) : 0);
}

EXPORT void taxels_receive(TaxelBoard *board, const uint8_t *bytes, int32_t count)
{
    board->receive(bytes, count);
}
