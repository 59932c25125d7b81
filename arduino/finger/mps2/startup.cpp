// Reset: floating point on, variables in place, then main().
#include <stdint.h>
#include <string.h>

int main();

extern "C" {

extern uint8_t _data_start, _data_end, _data_load, _bss_start, _bss_end, _stack_top;
extern void (*const _init_start[])();
extern void (*const _init_end[])();

void reset_handler()
{
    // Coprocessors 10 and 11: full access (ARMv7-M, Coprocessor Access Control Register).
    *reinterpret_cast<volatile uint32_t *>(0xE000ED88) |= 0xFu << 20;
    asm volatile("dsb\n isb");
    memcpy(&_data_start, &_data_load, size_t(&_data_end - &_data_start));
    memset(&_bss_start, 0, size_t(&_bss_end - &_bss_start));
    for (void (*const *init)() = _init_start; init != _init_end; init++) (*init)();
    main();
    for (;;) {}
}

void unexpected() { for (;;) {} }

__attribute__((section(".vectors"), used)) const void *const VECTORS[16] = {
    &_stack_top,
    reinterpret_cast<const void *>(reset_handler),
    reinterpret_cast<const void *>(unexpected),  // NMI
    reinterpret_cast<const void *>(unexpected),  // hard fault
    reinterpret_cast<const void *>(unexpected),
    reinterpret_cast<const void *>(unexpected),
    reinterpret_cast<const void *>(unexpected),
};

}  // extern "C"
