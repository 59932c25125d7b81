#include "voltage.h"

/* Return the row of the present time, and the share of the row that has passed. */
static int row_now(const struct chip *chip, double *passed)
{
    double length = (double)(chip->slice_end - chip->slice_start), place;
    int row, last = chip->io.analog_rows - 1;
    *passed = 0;
    if (last <= 0 || length <= 0) return 0;
    place = (double)(chip->avr->cycle - chip->slice_start) / length * last;
    row = place < last ? (int)place : last - 1;
    *passed = place - row;
    return row;
}

/* Return the present value of a channel: a share of the reference, or a taxel's conductance. */
double analog_input(const struct chip *chip, int channel)
{
    const sim_io *io = &chip->io;
    double passed;
    int row = row_now(chip, &passed);
    double here = io->analog[row][channel];
    return io->analog_rows > 1 ? here + (io->analog[row + 1][channel] - here) * passed : here;
}

double analog_noise(const struct chip *chip, int channel)
{
    double passed;
    return chip->io.analog_noise[row_now(chip, &passed)][channel];
}
