// Serves the registers: reads, and writes that take effect as a whole or not at all.
#ifndef REGISTERS_H
#define REGISTERS_H

#include <stdint.h>

#include "bank.h"  // words, bounds, guards

enum class Answer : uint8_t { Ok = 0, NoRegister = 2, OutOfRange = 3, Refused = 4 };

// What the registers control. The whole drum implements it, and so does a fake in the tests.
class RegisterHandler {
  public:
    // Updates the readable words; called once before each read.
    virtual void refresh() = 0;
    // Returns a word of the load-cell ring, at reg::ring_raw or above.
    virtual uint16_t ring_word(uint16_t address) = 0;
    // Returns whether settings with this guard may change now.
    virtual bool may_change(Guard guard) const = 0;
    // Starts a command whose settings are all in place; false refuses the write.
    virtual bool command(Command command, uint16_t sequence) = 0;
    // Applies settings that were written and accepted.
    virtual void written(uint16_t address, uint16_t count) = 0;

  protected:
    ~RegisterHandler() = default;
};

class Registers {
  public:
    Registers(Bank &bank, RegisterHandler &handler) : bank_(bank), handler_(handler) {}

    Answer check_read(uint16_t address, uint16_t count) const;
    void refresh() { handler_.refresh(); }
    uint16_t read(uint16_t address) const;
    // Writes big-endian words.
    Answer write(uint16_t address, uint16_t count, const uint8_t *bytes);

  private:
    Answer accept(uint16_t address, uint16_t count, const uint16_t *before);

    Bank &bank_;
    RegisterHandler &handler_;
};

#endif  // REGISTERS_H
