// Reads the simulated HX711 like a data sheet would: for tests of the simulator, not of the rig.
// Sends three bytes a conversion, high byte first. The host sends '1' … '3' to choose the pulses
// behind the data, 'p' to power the amplifier down for 100 µs.
#include <avr/io.h>
#include <util/delay.h>

#define DOUT (PIND & _BV(2))
#define SCK _BV(3)

static void pulse(void)
{
    PORTE |= SCK;
    _delay_us(1);
    PORTE &= ~SCK;
    _delay_us(1);
}

static void send(uint8_t byte)
{
    while (!(UCSR0A & _BV(UDRE0))) {}
    UDR0 = byte;
}

int main(void)
{
    uint8_t extra = 1;
    DDRE = SCK;
    UCSR0A = _BV(U2X0);
    UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
    UBRR0 = 16;
    UCSR0B = _BV(TXEN0) | _BV(RXEN0);
    for (;;) {
        if (UCSR0A & _BV(RXC0)) {
            uint8_t wish = UDR0;
            if (wish == 'p') {
                PORTE |= SCK;
                _delay_us(100);
                PORTE &= ~SCK;
            } else {
                extra = wish - '0';
            }
        }
        if (DOUT) continue;
        for (uint8_t byte = 0; byte < 3; byte++) {
            uint8_t bits = 0;
            for (uint8_t bit = 0; bit < 8; bit++) {
                PORTE |= SCK;
                _delay_us(1);
                bits = bits << 1 | (DOUT ? 1 : 0);
                PORTE &= ~SCK;
                _delay_us(1);
            }
            send(bits);
        }
        for (uint8_t i = 0; i < extra; i++) pulse();
    }
}
