#include "script.h"

#include <string.h>

#include "model.h"
#include "taxel_line.h"

namespace {

// The script: magic, then records of a line (u32), a size in bytes (u32) and as many bytes,
// padded to four. Line END ends it.
const uint8_t *const SCRIPT = reinterpret_cast<const uint8_t *>(0x60000000);
const uint32_t MAGIC = 0x474E4946;  // "FING"
enum class Line : uint32_t { End = 0, Host = 1, Taxels = 2, Converter = 3 };

uint32_t u32_at(const uint8_t *at)
{
    uint32_t value;
    memcpy(&value, at, sizeof value);
    return value;
}

// Arm semihosting: operation in r0, its arguments or their address in r1.
int32_t semihost(int32_t operation, const void *arguments)
{
    register int32_t r0 asm("r0") = operation;
    register const void *r1 asm("r1") = arguments;
    asm volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

const int32_t SYS_OPEN = 0x01, SYS_WRITE = 0x05, SYS_EXIT = 0x18;
const int32_t OPEN_WRITE = 4;
const void *const APPLICATION_EXIT = reinterpret_cast<const void *>(0x20026);

class StandardOutput final : public HostLine {
public:
    StandardOutput()
    {
        const struct {
            const char *name;
            int32_t mode, name_size;
        } arguments = {":tt", OPEN_WRITE, 3};
        handle_ = semihost(SYS_OPEN, &arguments);
    }

    bool send(const uint8_t *bytes, uint8_t size) override
    {
        if (filled_ + size > sizeof buffer_) flush();
        memcpy(buffer_ + filled_, bytes, size);
        filled_ += size;
        return true;
    }

    void flush()
    {
        const struct {
            int32_t handle;
            const void *bytes;
            uint32_t size;
        } arguments = {handle_, buffer_, filled_};
        semihost(SYS_WRITE, &arguments);
        filled_ = 0;
    }

private:
    int32_t handle_;
    uint32_t filled_ = 0;
    uint8_t buffer_[65536];
};

// With QEMU's -icount shift=0 an instruction takes a nanosecond, and SysTick counts at 25 MHz.
class InstructionCounter {
public:
    InstructionCounter()
    {
        registers_[1] = MASK;  // reload value
        registers_[2] = 0;
        registers_[0] = 5;     // on, processor clock, no interrupt
    }

    void start() { begin_ = registers_[2]; }

    void stop()
    {
        const uint32_t instructions = ((begin_ - registers_[2]) & MASK) * INSTRUCTIONS_PER_TICK;
        if (instructions > longest) longest = instructions;
        total += instructions;
        samples++;
    }

    uint32_t longest = 0, samples = 0;
    uint64_t total = 0;

private:
    static const uint32_t MASK = 0xFFFFFF, INSTRUCTIONS_PER_TICK = 40;
    volatile uint32_t *registers_ = reinterpret_cast<volatile uint32_t *>(0xE000E010);
    uint32_t begin_ = 0;
};

void take_samples(Finger &finger, const uint8_t *bytes, uint32_t size, InstructionCounter &counter)
{
    for (const uint8_t *end = bytes + size; bytes != end; bytes += 2 * TAXELS) {
        Sample sample;
        memcpy(sample.reading, bytes, sizeof sample.reading);
        counter.start();
        finger.take_sample(sample, 0);
        counter.stop();
    }
}

void take_taxel_bytes(Finger &finger, const uint8_t *bytes, uint32_t size)
{
    static TaxelLine taxel_line;
    Sample sample;
    for (uint32_t i = 0; i < size; i++)
        if (taxel_line.feed(bytes[i], sample)) {
            finger.set_damaged_frames(taxel_line.damaged());
            finger.take_sample(sample, taxel_line.lost());
        }
}

}  // namespace

bool has_script() { return u32_at(SCRIPT) == MAGIC; }

void run_script()
{
    static StandardOutput output;  // here: its constructor calls the debugger, which may be absent
    static Finger finger(output, MODEL);
    InstructionCounter counter;
    finger.begin();
    const uint8_t *at = SCRIPT + 4;
    for (;;) {
        const Line line = Line(u32_at(at));
        const uint32_t size = u32_at(at + 4);
        const uint8_t *bytes = at + 8;
        if (line == Line::End) break;
        if (line == Line::Host)
            for (uint32_t i = 0; i < size; i++) finger.receive(bytes[i]);
        if (line == Line::Taxels) take_taxel_bytes(finger, bytes, size);
        if (line == Line::Converter) take_samples(finger, bytes, size, counter);
        at = bytes + (size + 3) / 4 * 4;
    }
    const uint32_t counted[3] = {counter.longest, uint32_t(counter.total / 1000), counter.samples};
    output.send(reinterpret_cast<const uint8_t *>(counted), sizeof counted);
    output.flush();
    semihost(SYS_EXIT, APPLICATION_EXIT);
}
