// A script of bytes in the board's memory, for tests: QEMU's serial ports move 20 bytes a
// millisecond, its loader (-device loader) lays down megabytes at once.
#ifndef FINGER_MPS2_SCRIPT_H
#define FINGER_MPS2_SCRIPT_H

#include <stdint.h>

#include "finger.h"

// True when the loader has laid down a script.
bool has_script();

// Passes the script's bytes to the lines in their order, writes what the board sends to standard
// output by semihosting, then the instructions of the longest and of all samples, and exits.
void run_script();

#endif
