#include "neurons.h"

#include <math.h>

#include "neuron_constants.h"

Neurons::Neurons()
{
    Ranges full_scale = {};
    for (uint16_t &high : full_scale.high) high = 1023;
    set_ranges(full_scale);
    gain.shift = 0;
    for (uint16_t &one : gain.gains) one = GAIN_ONE;
    reset();
}

void Neurons::set_ranges(const Ranges &ranges)
{
    ranges_ = ranges;
    for (uint8_t i = 0; i < TAXELS; i++) {
        const uint16_t width = uint16_t(ranges.high[i] - ranges.low[i]);
        drive_[i] = width ? neuron::DRIVE * (1.0 / width) : 0.0;
    }
}

void Neurons::reset()
{
    for (uint8_t i = 0; i < TAXELS; i++) {
        membrane_[i] = neuron::REST_MEMBRANE;
        recovery_[i] = neuron::REST_RECOVERY;
    }
}

// The normal form of rigctl/encoder/kernel/constants.py: three fused operations a substep.
uint8_t Neurons::advance_one(uint8_t taxel, double input)
{
    NeuronState m = membrane_[taxel], q = recovery_[taxel];
    uint8_t spikes = 0;
    for (uint8_t substep = 0; substep < neuron::SUBSTEPS; substep++) {
        m = NeuronState(fma(m, m, fma(neuron::COUPLING, q, input)));
        q = NeuronState(fma(neuron::DECAY, q, m));
        if (m >= neuron::THRESHOLD) {
            m = NeuronState(neuron::RESET_TO);
            q = NeuronState(q + neuron::JUMP);
            spikes++;
        }
    }
    membrane_[taxel] = m;
    recovery_[taxel] = q;
    return spikes;
}

// The limits of shift and gains keep every product within 32 bits. A right shift of a negative
// number rounds down, as the compilers of all builds and the encoder do.
int32_t ForceGain::at(int32_t sum) const
{
    const int32_t step = int32_t(1) << shift;
    int32_t knot = sum >> shift;
    if (knot > GAIN_STEPS - 1) knot = GAIN_STEPS - 1;
    int32_t into = sum - knot * step;
    if (into > step) into = step;
    return gains[knot] + (((int32_t(gains[knot + 1]) - gains[knot]) * into) >> shift);
}

void Neurons::advance(Sample &sample)
{
    int32_t above[TAXELS], sum = 0;
    for (uint8_t i = 0; i < TAXELS; i++) {
        const int32_t over = int32_t(sample.reading[i]) - ranges_.low[i];
        above[i] = over > 0 ? over : 0;
        sum += above[i];
    }
    const int32_t factor = gain.at(sum);
    for (uint8_t i = 0; i < TAXELS; i++) {
        const int32_t width = ranges_.high[i] - ranges_.low[i];
        const int32_t scaled = (above[i] * factor) >> GAIN_BITS;
        const double x = scaled < width ? scaled : width;
        sample.spikes[i] = advance_one(i, fma(drive_[i], x, neuron::INPUT_AT_REST));
    }
}
