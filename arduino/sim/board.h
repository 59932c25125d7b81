/* Inside of a simulated board; only the files of this folder include it. */
#ifndef RIGCTL_SIM_BOARD_H
#define RIGCTL_SIM_BOARD_H

#include "sim_avr.h"
#include "avr_adc.h"
#include "avr_ioport.h"
#include "avr_timer.h"
#include "avr_uart.h"
#include "sim.h"

#define NEVER UINT64_MAX
#define BIT(value, n) ((value) >> (n) & 1)

struct serial {
    avr_uart_t *uart;
    avr_irq_t *input;
    uint8_t queue[SIM_MAX_BYTES * 2]; /* from the host, not yet on the wire */
    uint32_t head, tail;
    uint64_t next_q16;      /* cycle × 65536 at which the next byte may begin */
    uint64_t wire_free;     /* cycle at which the last byte sent is out */
    uint64_t rx_raised;     /* cycle at which a received byte raised its interrupt, 0: none */
    int full;               /* the chip's receiver has no room */
};

struct loadcell {
    uint64_t ready_q16;     /* cycle × 65536 of the next conversion's end */
    uint64_t sck_rise, read_start;
    uint64_t offered;       /* cycle at which the conversion held was offered */
    int32_t held;           /* conversion offered to the reader */
    int32_t last;           /* last conversion, for the frozen mode */
    int settling;           /* conversions to swallow */
    int pulses;             /* clock rises of the read under way, 0: none */
    int gain_pulses;        /* pulses that chose the gain of the coming conversion */
    int sck, dout, down;
};

struct inputs {
    uint64_t cycle[SIM_MAX_INPUTS * 2];
    uint8_t signal[SIM_MAX_INPUTS * 2], level[SIM_MAX_INPUTS * 2];
    uint32_t head, tail;
};

struct drum {
    int64_t steps;               /* where the last pulse wants the drum */
    double from;                 /* where it was at that pulse */
    uint64_t stepped, interval;  /* cycle of the last pulse, and the time from the one before */
    int index_pin;               /* what the chip sees of the index mark */
    int matched;                 /* the compare unit has met what was last written to it */
};

struct watched {
    sim_board *board;
    uint8_t vector;
};

struct profile {
    struct watched watched[SIM_VECTORS];
    uint64_t entered[SIM_VECTORS]; /* stack of entry cycles */
    uint8_t vector[SIM_VECTORS];
    int depth;
    uint64_t off_since;            /* cycle at which interrupts went off, 0: they are on */
};

struct sim_board {
    avr_t *avr;
    int kind;
    int was_reset;
    int keep_edges;      /* edges reported since the last run, by a reset from outside */
    uint64_t slice_start, slice_end;
    void (*chip_reset)(struct avr_t *avr);
    avr_adc_t *adc;
    avr_io_read_t pins_read; /* taxels: simavr's own reading of port D */
    struct serial serial;
    struct loadcell loadcell;
    struct inputs inputs;
    struct profile profile;
    uint8_t out_level[8];
    uint8_t pull_mask[16], pull_value[16]; /* per port letter A … P */
    double duty, duty_sum;                 /* bridge duty now, and its integral over the slice */
    uint64_t duty_since;
    avr_timer_t *sampler;                  /* taxels: timer 1 */
    int compare_latched;                   /* OCF1B has been set and not been cleared */
    uint64_t triggered;                    /* cycle of the compare that starts a conversion */
    struct drum drum;
    sim_exchange exchange;
};

/* board.c */
void report_edge(sim_board *board, int signal, int level);
void report_edge_at(sim_board *board, uint64_t cycle, int signal, int level);
void schedule(sim_board *board);
avr_io_t *find_io(avr_t *avr, const char *kind);

/* pins.c */
void pins_open(sim_board *board);
void pins_restore(sim_board *board);
void pins_begin(sim_board *board);
uint64_t pins_next(const sim_board *board);
void pins_run(sim_board *board, uint64_t now);
void set_pin(sim_board *board, char port, int bit, int level);
void on_output(sim_board *board, int signal, int level);

/* motor.c */
void motor_open(sim_board *board);
void motor_step(sim_board *board);
void motor_show_mark(sim_board *board);
void motor_end(sim_board *board);

/* bridge.c */
void bridge_open(sim_board *board);
void bridge_changed(sim_board *board);
void bridge_begin(sim_board *board);
void bridge_end(sim_board *board);

/* serial.c */
void serial_open(sim_board *board);
void serial_begin(sim_board *board);
void serial_restore(sim_board *board);
uint64_t serial_next(const sim_board *board);
void serial_run(sim_board *board, uint64_t now);

/* analog.c */
void analog_open(sim_board *board);
double share_now(const sim_board *board, int channel);

/* sensor.c */
void sensor_open(sim_board *board);
int sensor_is_odd(const sim_board *board);
double sensor_share(const sim_board *board, int input);

/* loadcell.c */
void loadcell_open(sim_board *board);
uint64_t loadcell_next(const sim_board *board);
void loadcell_run(sim_board *board, uint64_t now);
void loadcell_clock(sim_board *board, int level);
void loadcell_restore(sim_board *board);

/* profile.c */
void profile_open(sim_board *board);
void profile_restore(sim_board *board);
void profile_look(sim_board *board);

#endif
