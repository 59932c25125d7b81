// Taxel board, Arduino Uno: 18 taxels, 10 bit, exactly 1,000 frames a second at 500 kbaud.
//
// The IDE wants a file of the folder's name; the program is in the .cpp files beside it:
//   chip_main.cpp      main loop: pack, send, hear the host, sleep
//   chip_sampling.cpp  timer, converter, lines, sync and index; the timing is told there
//   chip_test.cpp      self-test: a step a frame in the spare slots
//   chip_serial.cpp    transmit ring, receive ring
//   chip_boot.cpp      reset cause, count of boots, unused stack
//   wire.cpp, cobs.cpp, crc32.cpp, request.cpp, self_test.cpp   bytes; these run on the PC as well
// Pins, polarity, dividers: board.h. Frames: docs/reference/taxel-wire.md.
