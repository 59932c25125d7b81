// A slot's life, in cycles of its 800:
//
//   0    timer 1 reaches its top; the rising compare flag OCF1B starts the conversion
//   64   the reading is held; the line may move from here on
//   432  the conversion is complete, ADC_vect comes (within about 120 cycles of other routines)
//   500  the result is read, then the next line is driven and the next input selected, which
//        leaves about 300 cycles, 19 µs, to settle, and 10 µs where other routines came first;
//        then OCF1B is cleared, or no further trigger would come
//
// A frame begins with the trigger of slot 0 and is closed by the routine that reads slot 0 of
// the next frame, so edges of sync and index up to the boundary still count into it. For sync
// the capture unit tells on which side of the boundary a rise was, whatever the latency.
#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#include "chip.h"
#include "chip_reset.h"
#include "plan.h"
#include "ports.h"

namespace sampling {
volatile uint8_t frame_closed;
}  // namespace sampling

namespace {

constexpr uint8_t BANDGAP = _BV(REFS0) | BANDGAP_MUX;
constexpr uint8_t BANDGAP_SLOT = SLOTS - 1;      // the one before it lets the bandgap settle
constexpr uint16_t WRAPPED_BEFORE = 400;         // entered so early: the next trigger has passed
constexpr uint16_t IN_TIME_BEFORE = 592;         // entered by then, a line gets its 10 µs to settle
constexpr uint8_t CONVERT = _BV(ADEN) | _BV(ADIE) | _BV(ADATE) | _BV(ADPS2) | _BV(ADPS0);
constexpr uint8_t ISR_FRAME_CYCLES = 201;        // entry, saving and restoring registers, reti

// What PORTD and ADMUX hold while a slot is sampled. In RAM: it saves cycles in the routine.
struct Setup {
    uint8_t lines, mux;
};

// The scan: line by line, in each all inputs, then the bandgap.
constexpr Setup setup_of(uint8_t slot) {
    return slot < TAXELS ? Setup{uint8_t(PORTD_IDLE ^ 1 << LINE_BIT[slot / INPUTS]),
                                 uint8_t(_BV(REFS0) | INPUT_CHANNEL[slot % INPUTS])}
                         : Setup{PORTD_IDLE, BANDGAP};
}
#define SETUPS(slot) setup_of(slot), setup_of(slot + 1), setup_of(slot + 2), setup_of(slot + 3)
Setup setup[SLOTS] = {SETUPS(0), SETUPS(4), SETUPS(8), SETUPS(12), SETUPS(16)};

Frame frames[2];
Frame *filling = &frames[0], *closed = &frames[1];
uint16_t *store = frames[0].reading;
uint8_t slot;                   // the slot whose conversion ends next
uint16_t taken;                 // its result, where it was taken in time
bool in_time;
uint8_t frame_flags;
bool running;                   // a first frame has begun
uint32_t samples;
uint16_t late_slots, missed, longest;

// The task of the spare slots. A self-test has slot 19 convert an input instead of the
// bandgap, its line tests lie between the two.
volatile uint8_t spare_pulls;   // pull-ups of port C during slot 19
volatile uint8_t spare_asked;   // number of the order; served when it comes back
volatile uint8_t line_asked;    // mask of the line to test, 0: none
uint8_t spare_taken;
volatile uint8_t spare_served;
uint16_t spare_reading;
LineTest line_found;

uint8_t pins;                   // sync and index as last seen
uint8_t sync_count, index_count;// of the frame being filled; index marks count by four
// Edges after the boundary, not yet closed into a frame.
bool any_late;
uint8_t late_rises, late_marks, late_toggles;
uint16_t sync_rises;

inline uint16_t cycles_since(uint16_t entered) {
    uint16_t lasted = TCNT1 - entered;
    return lasted > SLOT_CYCLES ? lasted + SLOT_CYCLES : lasted;
}

inline void note_duration(uint16_t entered) {
    uint16_t lasted = cycles_since(entered);
    if (lasted > longest) longest = lasted;
}

// Counts edges that came after the boundary into the frame that begins there.
__attribute__((noinline)) void begin_with_late_edges() {
    frame_flags = late_marks ? FLAG_INDEX : 0;
    sync_count += late_rises;
    index_count += uint8_t(late_marks << 2);
    late_rises = late_marks = late_toggles = 0;
    any_late = false;
}

// Ends the full frame and continues with the other buffer.
inline void close_frame() {
    Frame *full = filling;
    full->counter = samples++;
    full->edges = uint8_t((sync_count & 0x03) | (index_count & 0x0c));
    full->flags = uint8_t(frame_flags | ((pins ^ late_toggles) & SYNC_MASK));
    frame_flags = 0;
    if (any_late) begin_with_late_edges();
    if (sampling::frame_closed) {
        missed++;
        reset::count_ms_in_isr();
    }
    sampling::frame_closed = 1;
    filling = closed;
    closed = full;
    store = filling->reading;
}

// One line follows its driver to both levels while the others only listen: what does not
// follow is stuck, what follows with it is connected to it. About 60 cycles.
__attribute__((noinline)) void test_line(uint8_t line) {
    const uint8_t others = LINE_MASK & uint8_t(~line);
    DDRD = line;
    PORTD = uint8_t(PORTD_IDLE ^ line);
    __asm__ volatile("nop\n nop\n nop\n nop");
    uint8_t driven = PIND;
    PORTD = PORTD_IDLE;
    __asm__ volatile("nop\n nop\n nop\n nop");
    uint8_t rested = PIND;
    DDRD = LINE_MASK;
    uint8_t high = DRIVE_HIGH ? driven : rested, low = DRIVE_HIGH ? rested : driven;
    if (!(high & line)) line_found.low |= line;
    if (low & line) line_found.high |= line;
    uint8_t with_it = uint8_t(driven ^ rested) & others;
    if (with_it) line_found.together |= line | with_it;
}

inline void spare_slot(uint8_t done, uint16_t reading) {
    if (done == BANDGAP_SLOT) {
        spare_reading = reading;
        spare_served = spare_taken;
    } else if (line_asked) {
        test_line(line_asked);
        line_asked = 0;
    }
}

inline uint8_t after(uint8_t done) {
    return done == SLOTS - 1 ? 0 : uint8_t(done + 1);
}

void note_late(bool overrun) {
    late_slots++;
    frame_flags |= overrun ? FLAG_LATE | FLAG_OVERRUN : FLAG_LATE;
}

inline void store_reading(uint8_t done, uint16_t reading) {
    if (done == 0 && running) close_frame();
    running = true;
    if (done < TAXELS) *store++ = reading;
    else spare_slot(done, reading);
}

}  // namespace

// Entered at 336 … 591 cycles, that is in time, the result is taken and the next line driven
// and input selected immediately. The taxels' slots but the first need no more: 80 cycles with
// entry. By hand, because
// the compiler would save twenty registers first, for the sake of the rare cases.
// The longest, in a self-test: 398 cycles, 25 µs.
ISR(ADC_vect, ISR_NAKED) {
    __asm__ volatile(
        "push r24\n in r24, __SREG__\n push r24\n push r25\n push r30\n push r31\n"
        "lds r24, %[tcnt]\n"
        "lds r25, %[tcnt]+1\n"
        "subi r24, lo8(%[limit])\n"
        "sbci r25, hi8(%[limit])\n"
        "cpi r25, 0xff\n"
        "breq 4f\n"
        "rjmp 3f\n"
        "4: lds r25, %[slot]\n"
        "subi r25, 1\n"
        "cpi r25, %[taxels]-1\n"
        "brsh 1f\n"
        "lds r30, %[store]\n"
        "lds r31, %[store]+1\n"
        "lds r24, %[adc]\n"
        "st Z+, r24\n"
        "lds r24, %[adc]+1\n"
        "st Z+, r24\n"
        "sts %[store]+1, r31\n"
        "sts %[store], r30\n"
        "subi r25, -2\n"
        "sts %[slot], r25\n"
        "lsl r25\n"
        "mov r30, r25\n"
        "ldi r31, 0\n"
        "subi r30, lo8(-(%[setup]))\n"
        "sbci r31, hi8(-(%[setup]))\n"
        "ld r24, Z\n"
        "out %[portd], r24\n"
        "ldd r24, Z+1\n"
        "sts %[admux], r24\n"
        "ldi r24, %[ocf1b]\n"
        "out %[tifr1], r24\n"
        "pop r31\n pop r30\n pop r25\n pop r24\n out __SREG__, r24\n pop r24\n reti\n"
        "1: lds r24, %[adc]\n"
        "lds r30, %[adc]+1\n"
        "sts %[taken]+1, r30\n"
        "sts %[taken], r24\n"
        "subi r25, -2\n"
        "cpi r25, %[slots]\n"
        "brne 2f\n"
        "ldi r25, 0\n"
        "2: lsl r25\n"
        "mov r30, r25\n"
        "ldi r31, 0\n"
        "subi r30, lo8(-(%[setup]))\n"
        "sbci r31, hi8(-(%[setup]))\n"
        "ld r24, Z\n"
        "out %[portd], r24\n"
        "ldd r24, Z+1\n"
        "sts %[admux], r24\n"
        "ldi r24, 1\n"
        "sts %[in_time], r24\n"
        "3: pop r31\n pop r30\n pop r25\n pop r24\n out __SREG__, r24\n pop r24\n"
        "jmp __vector_adc_slow\n"
        :
        : [tcnt] "i"(_SFR_MEM_ADDR(TCNT1)), [adc] "i"(_SFR_MEM_ADDR(ADC)),
          [admux] "i"(_SFR_MEM_ADDR(ADMUX)), [portd] "I"(_SFR_IO_ADDR(PORTD)),
          [tifr1] "I"(_SFR_IO_ADDR(TIFR1)), [ocf1b] "M"(_BV(OCF1B)), [taxels] "M"(TAXELS),
          [slots] "M"(SLOTS), [limit] "i"(IN_TIME_BEFORE), [slot] "i"(&slot),
          [store] "i"(&store), [setup] "i"(&setup), [taken] "i"(&taken), [in_time] "i"(&in_time));
}

// Slot 0, the spare slots, and whatever came too late.
extern "C" void __vector_adc_slow() __attribute__((signal, used, externally_visible));
extern "C" void __vector_adc_slow() {
    uint16_t entered = TCNT1;
    uint8_t done = slot;
    uint8_t next = after(done);
    bool late = !in_time;
    uint16_t reading = taken;
    if (late) {
        uint8_t low = ADCL;
        reading = uint16_t(ADCH << 8 | low);
        bool overrun = entered < WRAPPED_BEFORE;
        if (overrun) next = after(next);
        PORTD = setup[next].lines;
        ADMUX = setup[next].mux;
        note_late(overrun);
    }
    in_time = false;
    PORTC = next == BANDGAP_SLOT ? spare_pulls : 0;
    TIFR1 = _BV(OCF1B);
    slot = next;
    if (next == BANDGAP_SLOT) spare_taken = spare_asked;
    // Once, or twice where the trigger of one slot was lost: its place is filled, the
    // millisecond stays.
    do {
        store_reading(done, reading);
        done = after(done);
    } while (done != next);
    note_duration(entered);
}

// An edge of sync or index. While slot 0 is awaited, OCF1B tells whether the frame's boundary
// has passed; the capture register, whether a rise of sync came before it all the same. 184 cycles,
// 12 µs.
ISR(PCINT0_vect) {
    bool passed = slot == 0 && (TIFR1 & _BV(OCF1B));
    uint16_t entered = TCNT1;
    uint16_t captured = ICR1;
    uint8_t now = PINB & WATCHED_MASK;
    uint8_t rose = now & uint8_t(~pins);
    if (rose & SYNC_MASK) {
        sync_rises++;
        if (passed && captured <= entered) late_rises++;
        else sync_count++;
        // The level, too, belongs to the side on which the rise was.
        if (passed && captured <= entered) late_toggles ^= SYNC_MASK;
    } else if (passed) {
        late_toggles ^= (now ^ pins) & SYNC_MASK;
    }
    if (rose & INDEX_MASK) {
        if (passed) {
            late_marks++;
        } else {
            index_count += 4;
            frame_flags |= FLAG_INDEX;
        }
    }
    any_late = late_rises | late_marks | late_toggles;
    pins = now;
    note_duration(entered);
}

// The first conversion takes 25 ADC clocks instead of 13, a whole slot: it is thrown away here.
static void warm_up() {
    ADMUX = setup[0].mux;
    ADCSRA = _BV(ADEN) | _BV(ADSC) | _BV(ADPS2) | _BV(ADPS0);
    while (ADCSRA & _BV(ADSC)) {}
}

namespace sampling {

void begin() {
    PORTD = setup[0].lines;
    DDRD = LINE_MASK;
    PORTB = uint8_t(~WATCHED_MASK) & 0x3f;
    DIDR0 = 0x3f;
    pins = PINB & WATCHED_MASK;
    PCMSK0 = WATCHED_MASK;
    PCICR = _BV(PCIE0);
    warm_up();
    ADCSRB = _BV(ADTS2) | _BV(ADTS0);
    ADCSRA = CONVERT | _BV(ADIF);
    OCR1A = SLOT_CYCLES - 1;
    OCR1B = SLOT_CYCLES - 1;
    TCCR1B = _BV(ICES1) | _BV(WGM12) | _BV(CS10);
}

const Frame &take_frame() {
    const Frame *frame;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        frame_closed = 0;
        frame = closed;
    }
    return *frame;
}

}  // namespace sampling

uint16_t missed_frames() {
    uint16_t count;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { count = missed; }
    return count;
}

void report_sampling(Status &status) {
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        status.samples = samples;
        status.late_slots = late_slots;
        status.longest_isr_cycles = longest + ISR_FRAME_CYCLES;
        status.sync_rises = sync_rises;
    }
}

void ask_bandgap() {
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        setup[BANDGAP_SLOT].mux = BANDGAP;
        spare_pulls = 0;
        spare_asked++;
    }
}

void ask_input(uint8_t input, uint8_t pulled_inputs) {
    uint8_t pulls = 0;
    for (uint8_t i = 0; i < INPUTS; i++)
        if (pulled_inputs >> i & 1) pulls |= uint8_t(1 << INPUT_CHANNEL[i]);
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        setup[BANDGAP_SLOT].mux = uint8_t(_BV(REFS0) | INPUT_CHANNEL[input]);
        spare_pulls = pulls;
        spare_asked++;
    }
}

bool spare_answered(uint16_t &reading) {
    bool answered;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        answered = spare_served == spare_asked;
        reading = spare_reading;
    }
    return answered;
}

void ask_line(uint8_t line) {
    line_asked = uint8_t(1 << LINE_BIT[line]);
}

bool line_answered() {
    return line_asked == 0;
}

static uint8_t lines_of(uint8_t port_bits) {
    uint8_t lines = 0;
    for (uint8_t line = 0; line < LINES; line++)
        if (port_bits >> LINE_BIT[line] & 1) lines |= uint8_t(1 << line);
    return lines;
}

LineTest take_line_tests() {
    LineTest found = {lines_of(line_found.low), lines_of(line_found.high),
                      lines_of(line_found.together)};
    line_found = LineTest();
    return found;
}
