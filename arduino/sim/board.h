/* A simulated board and its peripherals; only the files of this folder include it. */
#ifndef RIGCTL_SIM_BOARD_H
#define RIGCTL_SIM_BOARD_H

#include "sim_avr.h"
#include "avr_ioport.h"
#include "analog.h"
#include "bridge.h"
#include "loadcell.h"
#include "motor.h"
#include "pins.h"
#include "profile.h"
#include "sensor.h"
#include "serial.h"
#include "sim.h"

#define NEVER UINT64_MAX
#define BIT(value, n) ((value) >> (n) & 1)

struct sim_board {
    avr_t *avr;
    int kind;
    int was_reset;
    int keep_edges; /* a reset from outside has reported edges since the last run */
    uint64_t slice_start, slice_end;
    void (*chip_reset)(struct avr_t *avr);
    struct serial serial;
    struct pins pins;
    struct analog analog;
    struct profile profile;
    struct sensor sensor;     /* taxels */
    struct loadcell loadcell; /* drum, as are the next two */
    struct motor motor;
    struct bridge bridge;
    sim_io io;
};

void report_edge(sim_board *board, int signal, int level);
void report_edge_at(sim_board *board, uint64_t cycle, int signal, int level);
void schedule(sim_board *board);
avr_io_t *find_io(avr_t *avr, const char *kind);

#endif
