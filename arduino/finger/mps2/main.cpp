// The finger board as an image for Arm's MPS2 board with a Cortex-M7: UART 0 to the host, UART 1
// from the taxel board.
#include "finger.h"
#include "model.h"
#include "script.h"
#include "taxel_line.h"
#include "uart.h"

namespace {

class UartLine final : public HostLine {
public:
    explicit UartLine(Uart &uart) : uart_(uart) {}

    bool send(const uint8_t *bytes, uint8_t size) override
    {
        for (; size; size--) uart_.write(*bytes++);
        return true;
    }

private:
    Uart &uart_;
};

}  // namespace

int main()
{
    if (has_script()) run_script();
    Uart host(0x40004000), taxels(0x40005000);
    UartLine line(host);
    Finger finger(line, MODEL);
    TaxelLine taxel_line;
    Sample sample;
    finger.begin();
    for (;;) {
        while (host.readable()) finger.receive(host.read());
        if (taxels.readable() && taxel_line.feed(taxels.read(), sample)) {
            finger.set_damaged_frames(taxel_line.damaged());
            finger.take_sample(sample, taxel_line.lost());
        }
    }
}
