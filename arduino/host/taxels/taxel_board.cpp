#include "taxel_board.h"

#include <string.h>

namespace {

// Diagnostics that only a chip has: on a PC no interrupt is late and no stack is short.
const uint16_t FREE_STACK_BYTES = 1024, ALL_IDLE_PERMILLE = 1000;

// An ideal divider and pull-up: the self-test's readings of fault-free wiring.
const uint32_t PULL_OHM = 35000;
const uint16_t PULLED_UP = uint16_t(1023UL * DIVIDER_OHM / (DIVIDER_OHM + PULL_OHM));

// The board whose firmware runs in this thread; the functions of ports.h take no board.
thread_local TaxelBoard *running = nullptr;

class Running {
public:
    explicit Running(TaxelBoard *board) : before_(running) { running = board; }
    ~Running() { running = before_; }

private:
    TaxelBoard *before_;
};

}  // namespace

void TaxelBoard::boot(uint8_t reset_cause)
{
    const Running here(this);
    reset_cause_ = reset_cause;
    line_ = SerialLine(BYTE_CYCLES);
    edges_.clear();
    requests_.clear();
    io.tx_count = 0;
    samples_ = 0;
    cycle_ = 0;
    sync_rises_ = marks_ = 0;
    ask_bandgap();
    talk_.reset(new Talk());
    talk_->begin(++boots_);
}

void TaxelBoard::edge(EdgeOf signal, bool level, uint64_t cycle)
{
    edges_.push_back({signal, level, cycle});
}

// An edge counts in the frame in which it occurs, like in the chip's interrupt.
void TaxelBoard::count(const Edge &edge, Frame &frame)
{
    if (edge.signal == EdgeOf::Sync) {
        sync_rises_ = uint16_t(sync_rises_ + (edge.level && !sync_level_));
        sync_level_ = edge.level;
    } else if (edge.level) {
        ++marks_;
        frame.flags |= FLAG_INDEX;
    }
}

Frame TaxelBoard::close_frame(int32_t row)
{
    Frame frame = Frame();
    cycle_ += FRAME_CYCLES;
    for (; !edges_.empty() && edges_.front().cycle < cycle_; edges_.pop_front())
        count(edges_.front(), frame);
    frame.counter = samples_++;
    frame.flags |= sync_level_ ? FLAG_SYNC : 0;
    frame.edges = uint8_t((sync_rises_ & 3) | (marks_ & 3) << 2);
    io.flags[row] = frame.flags;
    io.edges[row] = frame.edges;
    return frame;
}

void TaxelBoard::run(const uint16_t *readings, int32_t frames)
{
    const Running here(this);
    for (int32_t row = 0; row < frames; ++row, readings += TAXELS) {
        Frame frame = close_frame(row);
        memcpy(frame.reading, readings, sizeof frame.reading);
        talk_->take(frame);
    }
}

void TaxelBoard::close(int32_t frames)
{
    for (int32_t row = 0; row < frames; ++row) close_frame(row);
}

void TaxelBoard::receive(const uint8_t *bytes, int32_t count)
{
    requests_.insert(requests_.end(), bytes, bytes + count);
}

bool TaxelBoard::send(const uint8_t *bytes, uint8_t size, uint8_t kept_free)
{
    if (line_.waiting(cycle_) + size + kept_free > SEND_SIZE) return false;
    if (io.tx_count + size > MAX_BYTES) {
        ++io.overflows;
        return false;
    }
    memcpy(io.tx + io.tx_count, bytes, size);
    io.tx_count += size;
    line_.pass(size, cycle_);
    return true;
}

bool TaxelBoard::take(uint8_t &byte)
{
    if (requests_.empty()) return false;
    byte = requests_.front();
    requests_.pop_front();
    return true;
}

void TaxelBoard::report(Status &status) const
{
    status.samples = samples_;
    status.late_slots = 0;
    status.longest_isr_cycles = 0;
    status.sync_rises = sync_rises_;
}

// --- ports.h ---

bool serial_send(const uint8_t *bytes, uint8_t size, uint8_t kept_free)
{
    return running->send(bytes, size, kept_free);
}

bool serial_receive(uint8_t &byte) { return running->take(byte); }
uint16_t missed_frames() { return 0; }
void report_sampling(Status &status) { running->report(status); }
void ask_bandgap()
{
    running->ask_spare(uint16_t(BANDGAP_MV * 1024L / running->io.supply_mv));
}

void ask_input(uint8_t, uint8_t pulled_inputs) { running->ask_spare(pulled_inputs ? PULLED_UP : 0); }

bool spare_answered(uint16_t &reading)
{
    reading = running->spare();
    return true;
}

void ask_line(uint8_t) {}
bool line_answered() { return true; }
LineTest take_line_tests() { return LineTest(); }
uint8_t reset_cause() { return running->reset_cause(); }
uint16_t free_stack_bytes() { return FREE_STACK_BYTES; }
uint16_t idle_permille() { return ALL_IDLE_PERMILLE; }
