#include "neurons.h"

#include <math.h>

#include "neuron_constants.h"

Neurons::Neurons()
{
    Ranges full_scale = {};
    for (uint16_t &high : full_scale.high) high = 1023;
    set_ranges(full_scale);
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

void Neurons::advance(Sample &sample)
{
    for (uint8_t i = 0; i < TAXELS; i++) {
        const uint16_t low = ranges_.low[i], width = uint16_t(ranges_.high[i] - low);
        const uint16_t reading = sample.reading[i];
        const uint16_t above = reading > low ? uint16_t(reading - low) : 0;
        const double x = above < width ? above : width;
        sample.spikes[i] = advance_one(i, fma(drive_[i], x, neuron::INPUT_AT_REST));
    }
}
