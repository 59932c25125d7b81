// One pulse a round of timer 1, each begun by a match in the first cycles of the round, while the
// main loop is in the chip's longest instructions: for tests of the simulator, not of the rig.
#include <avr/interrupt.h>
#include <avr/io.h>

static volatile uint8_t place, up = 1;

ISR(TIMER1_COMPA_vect)
{
    up = !up;
    if (up) {
        OCR1A = 0x8000;
        return;
    }
    TCCR1A = 0;  // for a moment the pin shows its port bit, which nobody ever sets
    TCCR1A = _BV(COM1A0);
    place = (place + 1) & 7;
    OCR1A = place;
}

__attribute__((noinline)) static void call_and_return(void) { __asm__ volatile(""); }

int main(void)
{
    DDRA = _BV(PA1);
    DDRB = _BV(PB5);
    OCR1A = 0x8000;
    TCCR1B = _BV(CS10);
    TIMSK1 = _BV(OCIE1A);
    sei();
    for (;;) call_and_return();
}
