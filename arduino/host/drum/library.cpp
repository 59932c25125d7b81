// C functions of the drum's virtual board, for rigctl/bench/boards/drum_firmware.py.
#include "../export.h"
#include "drum_board.h"

#ifndef SOURCES
#error "say what the library is made of: -DSOURCES='\"…\"'"
#endif

EXPORT const char *drum_sources() { return SOURCES; }
EXPORT uint64_t drum_io_size() { return sizeof(DrumIO); }
EXPORT DrumBoard *drum_open() { return new DrumBoard(); }
EXPORT void drum_close(DrumBoard *board) { delete board; }
EXPORT DrumIO *drum_io(DrumBoard *board) { return &board->io; }
EXPORT void drum_boot(DrumBoard *board, int32_t cause) { board->boot(static_cast<uint8_t>(cause)); }
EXPORT void drum_run(DrumBoard *board, int64_t until) { board->run(static_cast<uint64_t>(until)); }
EXPORT void drum_poll(DrumBoard *board, int64_t) { board->poll(); }
EXPORT void drum_place(DrumBoard *board, int64_t steps) { board->place(steps); }
EXPORT void drum_set_estop(DrumBoard *board, int32_t level) { board->set_estop(level != 0); }

EXPORT void drum_receive(DrumBoard *board, const uint8_t *bytes, int32_t count, int64_t from) {
    board->receive(bytes, count, static_cast<uint64_t>(from));
}

EXPORT int32_t drum_write(DrumBoard *board, int32_t address, int32_t count, const uint8_t *bytes) {
    return board->write(static_cast<uint16_t>(address), static_cast<uint16_t>(count), bytes);
}

EXPORT void drum_read(DrumBoard *board, int32_t address, int32_t count, uint16_t *words) {
    board->read(static_cast<uint16_t>(address), static_cast<uint16_t>(count), words);
}
