/* The bench's two boards as simavr chips, driven from outside in slices of chip cycles.
 *
 * A sim_board is one AVR with its peripherals: a serial cable with real byte times, input pins that
 * change at exact cycles, output edges with cycle stamps, analog voltages that change linearly
 * within a slice, and for the drum an HX711, a motor with an index mark and a bridge. A caller fills
 * the inputs of sim_io, calls sim_run() once and reads the outputs. Boards share nothing, so one
 * process may hold several, each used by one thread at a time.
 *
 * simavr is GPL-3: this is a test tool built from a checkout, never part of a wheel.
 */
#ifndef RIGCTL_SIM_H
#define RIGCTL_SIM_H

#include <stdint.h>

#define SIM_CHANNELS 18   /* taxels of the Uno: line × 6 + input; the Mega uses [0] */
#define SIM_MAX_BYTES 4096
#define SIM_MAX_EDGES 8192
#define SIM_MAX_INPUTS 1024
#define SIM_VECTORS 64
#define SIM_MAX_ROWS 33

typedef struct sim_board sim_board;

enum sim_kind { SIM_DRUM = 0, SIM_TAXELS = 1 };

/* Output signals whose edges are reported. */
enum sim_output {
    SIM_OUT_STEP = 0,   /* PB5, drum: rises only */
    SIM_OUT_DIR = 1,    /* PA0, drum */
    SIM_OUT_ENABLE = 2, /* PA1, drum, level 0 is on, whatever the driver's polarity */
    SIM_OUT_SYNC = 3,   /* PA2, drum */
    SIM_OUT_BRIDGE = 4, /* PH5, drum, active high */
    SIM_OUT_SCK = 5,    /* PE3, drum: consumed by the HX711, not reported */
    SIM_OUT_INDEX = 6,  /* drum: the index mark at PE4 */
    SIM_OUT_SAMPLE = 7, /* taxels: a conversion started; level is its line × 6 + input */
};

/* Input pins that a caller may set at a cycle. */
enum sim_input {
    SIM_IN_ESTOP = 0,     /* PE5, drum, high = tripped */
    SIM_IN_END_UP = 1,    /* PC7, drum, high = at the end */
    SIM_IN_END_DOWN = 2,  /* PC6, drum, high = at the end */
    SIM_IN_INDEX = 3,     /* PB1, taxels */
    SIM_IN_SYNC = 4,      /* PB0, taxels */
    SIM_IN_MARK = 5,      /* PE4, drum, which the turning drum sets as well */
};

/* What the stepper's driver makes of the direction line. */
enum sim_direction {
    SIM_DIRECTION_DRAWN = 0,
    SIM_DIRECTION_REVERSED = 1,
    SIM_DIRECTION_STUCK = 2,    /* always forwards */
};

enum sim_loadcell_mode {
    SIM_LOADCELL_NORMAL = 0,
    SIM_LOADCELL_SILENT = 1,    /* no conversion becomes ready */
    SIM_LOADCELL_FROZEN = 2,    /* repeats the last conversion */
    SIM_LOADCELL_SATURATED = 3, /* full scale */
};

/* Inputs and outputs of a board. Python parses this declaration; the size is checked when the
 * library is loaded. */
typedef struct sim_io {
    /* in, valid until changed */
    /* Drum: voltages as shares of the reference. Taxels: conductances in units of the divider's.
     * Rows at equal distances, the first at the slice's start, the last at its end, linear in
     * between. Noise is added, in codes, per interval. */
    double analog[SIM_MAX_ROWS][SIM_CHANNELS];
    double analog_noise[SIM_MAX_ROWS][SIM_CHANNELS];
    double step_size;                  /* steps by which a pulse turns the drum */
    int64_t loadcell_period_q16;       /* HX711: chip cycles of one conversion × 65536 */
    int64_t host_byte_q16;             /* cable: chip cycles of one byte from the host × 65536 */
    int32_t loadcell_counts;           /* value of a conversion that ends in this slice */
    int32_t loadcell_mode;             /* enum sim_loadcell_mode */
    int32_t loadcell_clock_open;       /* 1: a resistor holds the amplifier's clock low */
    int32_t loadcell_data_open;        /* 1: the chip pulls its input up */
    int32_t supply_mv;                 /* of the chip, which is its reference */
    int32_t motor_jammed;              /* 1: step pulses do not turn the drum */
    int32_t direction;                 /* enum sim_direction */
    int32_t mark_length_steps;         /* index mark covers steps 0 … this − 1 of a turn */
    int32_t mark_inverted;             /* 1: the drum's chip sees the mark low */
    int32_t enable_high;               /* 1: high switches the stepper's driver on */
    int32_t port_a_first;              /* drum: bit of direction; enable and sync are the next */
    int32_t steps_per_turn;
    int32_t report_samples;            /* 1: report SIM_OUT_SAMPLE edges */
    int32_t report_steps;              /* 1: report SIM_OUT_STEP edges */
    int32_t analog_rows;               /* 1: constant, row 0 */
    int32_t watch_interrupts;          /* 1: check the interrupt flag after each instruction */
    /* Faults of the sensor's wiring, one bit per line or input: shorted to a level, connected to each
     * other, without a divider. */
    int32_t lines_low, lines_high, lines_together;
    int32_t inputs_low, inputs_high, inputs_together, inputs_open;
    int32_t driven_low;                /* 1: the driven line is low and dividers go to 5 V */
    /* in, consumed by sim_run */
    int32_t rx_count;
    int32_t input_count;
    uint64_t rx_start;                    /* cycle at which the host began to send rx */
    uint64_t input_cycle[SIM_MAX_INPUTS]; /* ascending */
    uint8_t input_signal[SIM_MAX_INPUTS]; /* enum sim_input */
    uint8_t input_level[SIM_MAX_INPUTS];
    uint8_t rx[SIM_MAX_BYTES];
    /* out, of the last sim_run */
    uint64_t tx_cycle[SIM_MAX_BYTES]; /* cycle at which the byte's stop bit ended */
    uint8_t tx[SIM_MAX_BYTES];
    uint64_t edge_cycle[SIM_MAX_EDGES];
    uint8_t edge_signal[SIM_MAX_EDGES]; /* enum sim_output */
    uint8_t edge_level[SIM_MAX_EDGES];
    int32_t tx_count;
    int32_t edge_count;
    uint64_t cycle;
    int32_t bridge_on, stepper_on; /* levels at the drivers' enables, 1: on */
    double drive;             /* mean signed duty of the bridge over the slice, + presses */
    int64_t drum_steps;       /* commanded position of the drum, in steps from the mark's start */
    double drum_place;        /* true position at the end: a step takes its time */
    uint64_t loadcell_ready;  /* cycle of the next conversion's end */
    /* out, since the board was opened */
    uint64_t resets;
    uint64_t rx_overruns;     /* bytes from the host that the full receiver lost */
    uint64_t rx_latency;      /* longest wait of a received byte for its interrupt, cycles */
    uint64_t overflows;       /* bytes or edges that did not fit */
    uint64_t slept_cycles;
    uint64_t isr_cycles;      /* inside interrupt routines, without the entry itself */
    uint64_t isr_count;
    uint64_t longest_isr[SIM_VECTORS]; /* of each vector, cycles from entry to reti */
    uint64_t loadcell_conversions;
    uint64_t loadcell_reads;  /* conversions that were shifted out completely */
    uint64_t longest_read;    /* first clock rise to last clock fall of a read, cycles */
    uint64_t loadcell_latency; /* longest time from an offered conversion to its read's end */
    uint64_t longest_off;     /* interrupts off outside of interrupt routines, with watch_interrupts */
} sim_io;

/* Loads an ELF image. Returns NULL when it cannot be read. */
sim_board *sim_open(const char *image, int kind);
void sim_close(sim_board *board);
sim_io *sim_io_of(sim_board *board);
unsigned long sim_io_size(void);

/* Runs to a cycle (at most one instruction past it). Returns 0, or 1 if the chip stopped. */
int sim_run(sim_board *board, uint64_t until);

/* Resets the chip, which sees one of these bits in MCUSR; SRAM is lost only by power. */
enum sim_reset_cause { SIM_POWER_ON = 1, SIM_RESET_PIN = 2, SIM_BROWN_OUT = 4 };
void sim_reset(sim_board *board, int cause);

/* Reads or writes the flash, as a programmer does. Returns 0 when it fits. */
int sim_flash_read(sim_board *board, uint32_t offset, uint8_t *bytes, uint32_t size);
int sim_flash_write(sim_board *board, uint32_t offset, const uint8_t *bytes, uint32_t size);

/* Lets every reset start at an address, as the fuses of a chip with a bootloader do. */
void sim_start_at(sim_board *board, uint32_t address);

/* Turns the drum to a step of its turn, its angle at power-up. */
void sim_place_drum(sim_board *board, int64_t steps);

/* Reads or writes the EEPROM; the contents outlive every reset. Returns 0 when it fits. */
int sim_eeprom_read(sim_board *board, uint32_t offset, uint8_t *bytes, uint32_t size);
int sim_eeprom_write(sim_board *board, uint32_t offset, const uint8_t *bytes, uint32_t size);

#endif
