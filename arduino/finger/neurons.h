// Nine slowly adapting neurons (Izhikevich, 2003) with the default preset of rigctl.encoder.
//
// Double precision and the encoder's own order of operations: the spikes are equal bit for bit.
// neuron_constants.h comes from the same constants (python -m rigctl.finger.neuron_header).
#ifndef FINGER_NEURONS_H
#define FINGER_NEURONS_H

#include <stdint.h>

const uint8_t TAXELS = 9;

// Lowest and highest reading of each taxel; they map to no input and to full input.
struct Ranges {
    uint16_t low[TAXELS], high[TAXELS];
};

// A gain on the currents for the force that all taxels together show (rigctl/encoder/force_gain.py):
// at 0, 1 … GAIN_STEPS steps of 2^shift of what they read above their low ends, in 1 / GAIN_ONE.
// The last one holds for more. Between two steps it is interpolated, in whole numbers.
const uint8_t GAIN_STEPS = 64, GAIN_BITS = 12, MAX_GAIN_SHIFT = 16;
const uint16_t GAIN_ONE = 1 << GAIN_BITS, MAX_GAIN = 5 * GAIN_ONE;
struct ForceGain {
    uint8_t shift;
    uint16_t gains[GAIN_STEPS + 1];

    int32_t at(int32_t sum) const;
};

// What nine taxels read in one millisecond, and how often their neurons fired in it.
struct Sample {
    uint16_t reading[TAXELS];
    uint8_t spikes[TAXELS];
};

typedef double NeuronState;

class Neurons {
public:
    Neurons();

    // Uses other ranges from the next sample on. Each low end must not be above its high end.
    void set_ranges(const Ranges &ranges);
    const Ranges &ranges() const { return ranges_; }

    // The gain from the next sample on; 1 until somebody sets it.
    ForceGain gain;

    // Puts all neurons at rest.
    void reset();

    // Advances all neurons by a millisecond and fills in the sample's spikes.
    void advance(Sample &sample);

private:
    uint8_t advance_one(uint8_t taxel, double input);

    Ranges ranges_;
    double drive_[TAXELS];
    NeuronState membrane_[TAXELS], recovery_[TAXELS];
};

#endif
