// Taxel board, Arduino Uno: the taxels of board.h, 10 bit, exactly 1,000 frames a second at 500 kbaud.
//
// The IDE wants a file of the folder's name; the program is in the .cpp files beside it:
//   chip_main.cpp      main loop: wait for a frame, have the brain talk
//   chip_sampling.cpp  timer, converter, lines, sync and index, with their timing
//   chip_serial.cpp    transmit ring, receive ring
//   chip_boot.cpp      count of boots, reset cause behind Optiboot
//   chip_reset.cpp     reset cause, watchdog, unused stack: the same file as the drum's
//   talk.cpp           the brain: what is sent when, and what the host asks for
//   self_test_course.cpp   a step of the self-test a frame, in the spare slots
//   wire.cpp, cobs.cpp, crc32.cpp, request.cpp, self_test.cpp   bytes
// All but chip_*.cpp runs on the PC as well, behind ports.h.
// Pins, polarity, dividers: board.h. Frames: docs/reference/taxel-wire.md.
