/* The firmware on an RP2040, such as a Raspberry Pi Pico. The buses of the six legs are moved together by software: a bit of
 * one is a bit of all, and a leg's short is its own. 400 kHz; no chip here stretches its clock.
 *
 *     GP0, GP1       TX and RX of the serial line, 2 Mbit/s, 8N1, 3.3 V
 *     GP2 to GP7     SDA of lf, lm, lr, rf, rm, rr
 *     GP8 to GP13    SCL of the same; 2.2 kOhm to 3.3 V at each of these twelve
 *
 * Source: RP2040 data sheet: 2.2 (addresses), 2.3.1.7 (SIO), 2.5.7 (DMA), 2.13.4 (PSM), 2.14.3 (resets), 2.15.7 (clocks),
 * 2.16.7 (crystal), 2.18.4 (PLL), 2.19.6 (pins and pads), 4.2.8 (UART, a PL011), 4.6.5 (timer), 4.7.6 (watchdog); I2C-bus
 * specification UM10204, table 11 (fast mode: low for 1.3 us, high for 0.6 us at least) and 3.1.16 (bus clear). */
#include "../footsense_scan.h"

#define REGISTER(address) (*(volatile uint32_t *)(address))
#define RESETS_CLEAR REGISTER(0x4000F000u) /* of RESET: its bits are cleared where a one is written */
#define RESETS_DONE REGISTER(0x4000C008u)
#define XOSC_CTRL REGISTER(0x40024000u)
#define XOSC_STATUS REGISTER(0x40024004u)
#define XOSC_STARTUP REGISTER(0x4002400Cu)
#define CLK_REF_CTRL REGISTER(0x40008030u)
#define CLK_REF_SELECTED REGISTER(0x40008038u)
#define CLK_SYS_CTRL REGISTER(0x4000803Cu)
#define CLK_SYS_SELECTED REGISTER(0x40008044u)
#define CLK_PERI_CTRL REGISTER(0x40008048u)
#define PLL_CS REGISTER(0x40028000u)
#define PLL_PWR REGISTER(0x40028004u)
#define PLL_FBDIV REGISTER(0x40028008u)
#define PLL_PRIM REGISTER(0x4002800Cu)
#define PSM_WDSEL REGISTER(0x40010008u)
#define WATCHDOG_CTRL REGISTER(0x40058000u)
#define WATCHDOG_LOAD REGISTER(0x40058004u)
#define WATCHDOG_TICK REGISTER(0x4005802Cu)
#define TIMERAWL REGISTER(0x40054028u)
#define PIN_CTRL(pin) REGISTER(0x40014004u + 8u * (pin))
#define PAD(pin) REGISTER(0x4001C004u + 4u * (pin))
#define GPIO_IN REGISTER(0xD0000004u)
#define GPIO_OUT_CLR REGISTER(0xD0000018u)
#define GPIO_OE_SET REGISTER(0xD0000024u)
#define GPIO_OE_CLR REGISTER(0xD0000028u)
#define UART_DR REGISTER(0x40034000u)
#define UART_FR REGISTER(0x40034018u)
#define UART_IBRD REGISTER(0x40034024u)
#define UART_FBRD REGISTER(0x40034028u)
#define UART_LCR_H REGISTER(0x4003402Cu)
#define UART_CR REGISTER(0x40034030u)
#define UART_DMACR REGISTER(0x40034048u)
#define DMA_READ_ADDR REGISTER(0x50000000u)
#define DMA_WRITE_ADDR REGISTER(0x50000004u)
#define DMA_TRANS_COUNT REGISTER(0x50000008u)
#define DMA_CTRL_TRIG REGISTER(0x5000000Cu)
#define SYST_CSR REGISTER(0xE000E010u)
#define SYST_RVR REGISTER(0xE000E014u)
#define SYST_CVR REGISTER(0xE000E018u)

enum {
    SDA = 2, /* pin of the first leg */
    SCL = 8,
    CYCLES_PER_US = 125,
    LOW_CYCLES = 15 * CYCLES_PER_US / 10,
    HIGH_CYCLES = CYCLES_PER_US,
    PERIPHERALS = 1 << 2 | 1 << 5 | 1 << 8 | 1 << 12 | 1 << 21 | 1 << 22, /* DMA, pins, pads, PLL, timer, UART */
    AS_UART = 2,
    AS_GPIO = 5,
    PAD_I2C = 0x5A, /* read, pulled up, Schmitt trigger, 4 mA */
    WATCHDOG_US = 100000
};

extern uint32_t footsense_bss[], footsense_bss_end[], footsense_stack_end[];

const char footsense_identity[] = "footsense mcu: AD7147, legs 1 to 6, RP2040";

static footsense_scan scan;
static uint32_t edge; /* the processor's clock when the lines were last moved; it counts down */

/* Waits since the lines were last moved. */
static void hold(uint32_t cycles)
{
    while (((edge - SYST_CVR) & 0xFFFFFFu) < cycles) {
    }
    edge = SYST_CVR;
}

/* Pins of legs, at the first leg's pin: open drain. */
static void low(uint32_t legs, unsigned pin)
{
    GPIO_OE_SET = legs << pin;
}

static void release(uint32_t legs, unsigned pin)
{
    GPIO_OE_CLR = legs << pin;
}

/* One bit with SCL low before it and behind it; returns the legs whose SDA is high. */
static uint32_t clock_bit(uint32_t legs, bool one)
{
    if (one) {
        release(legs, SDA);
    } else {
        low(legs, SDA);
    }
    hold(LOW_CYCLES);
    release(legs, SCL);
    hold(HIGH_CYCLES);
    uint32_t high = GPIO_IN >> SDA & legs;
    low(legs, SCL);
    return high;
}

static void start(uint32_t legs)
{
    release(legs, SDA);
    hold(LOW_CYCLES);
    release(legs, SCL);
    hold(HIGH_CYCLES);
    low(legs, SDA);
    hold(HIGH_CYCLES);
    low(legs, SCL);
}

static void stop(uint32_t legs)
{
    low(legs, SDA);
    hold(LOW_CYCLES);
    release(legs, SCL);
    hold(HIGH_CYCLES);
    release(legs, SDA);
    hold(LOW_CYCLES);
}

/* Returns the legs that acknowledge. */
static uint32_t write_byte(uint32_t legs, unsigned byte)
{
    for (unsigned mask = 0x80; mask != 0; mask >>= 1) {
        (void)clock_bit(legs, (byte & mask) != 0);
    }
    return legs & ~clock_bit(legs, true);
}

static void read_byte(uint32_t legs, uint8_t in[][FOOTSENSE_READ_MAX], unsigned at, bool last)
{
    for (int k = 0; k < 8; k++) {
        uint32_t high = clock_bit(legs, true);
        for (unsigned leg = 0; leg < FOOTSENSE_LEGS; leg++) {
            in[leg][at] = (uint8_t)(in[leg][at] << 1 | (high >> leg & 1u));
        }
    }
    (void)clock_bit(legs, last);
}

footsense_answer footsense_transfer(uint8_t legs, const uint8_t *out, uint8_t n_out,
                                    uint8_t in[][FOOTSENSE_READ_MAX], uint8_t n_in)
{
    edge = SYST_CVR;
    /* A chip that was interrupted in a byte holds SDA until that is over: nine clocks, and a stop. */
    uint32_t held = legs & ~(GPIO_IN >> SDA);
    if (held != 0) {
        for (int k = 0; k < 9; k++) {
            (void)clock_bit(held, true);
        }
        stop(held);
    }
    uint32_t stuck = legs & ~(GPIO_IN >> SDA & GPIO_IN >> SCL);
    uint32_t active = legs & ~stuck, answered;
    start(active);
    answered = write_byte(active, FOOTSENSE_ADDRESS << 1);
    for (unsigned k = 0; k < n_out; k++) {
        answered &= write_byte(active, out[k]);
    }
    if (n_in != 0) {
        start(active);
        answered &= write_byte(active, FOOTSENSE_ADDRESS << 1 | 1);
        for (unsigned k = 0; k < n_in; k++) {
            read_byte(active, in, k, k + 1u == n_in);
        }
    }
    stop(active);
    return (footsense_answer){(uint8_t)answered, (uint8_t)stuck};
}

uint32_t footsense_now_us(void)
{
    return TIMERAWL;
}

void footsense_wait_until_us(uint32_t t_us)
{
    WATCHDOG_LOAD = 2 * WATCHDOG_US; /* it counts twice a microsecond (erratum E1) */
    while ((int32_t)(t_us - TIMERAWL) > 0) {
    }
}

void footsense_send(const uint8_t *bytes, uint16_t n)
{
    while (DMA_CTRL_TRIG & 1u << 24) { /* busy: only where a scan is shorter than its records */
    }
    DMA_READ_ADDR = (uint32_t)bytes;
    DMA_WRITE_ADDR = (uint32_t)&UART_DR;
    DMA_TRANS_COUNT = n;
    DMA_CTRL_TRIG = 1u | 1u << 4 | 20u << 15 | 1u << 21; /* bytes, from rising addresses, at the pace of UART0's TX */
}

int footsense_receive(void)
{
    return UART_FR & 1u << 4 ? -1 : (int)(UART_DR & 0xFFu);
}

/* 125 MHz from the crystal of 12 MHz. */
static void start_clocks(void)
{
    XOSC_CTRL = 0xAA0;
    XOSC_STARTUP = 47;
    XOSC_CTRL = 0xFABAA0;
    while (!(XOSC_STATUS & 1u << 31)) {
    }
    CLK_REF_CTRL = 2;
    while (!(CLK_REF_SELECTED & 1u << 2)) {
    }
    CLK_SYS_CTRL = 0;
    while (!(CLK_SYS_SELECTED & 1u)) {
    }
    RESETS_CLEAR = PERIPHERALS;
    while ((RESETS_DONE & PERIPHERALS) != PERIPHERALS) {
    }
    PLL_CS = 1;
    PLL_FBDIV = 125; /* 1500 MHz */
    PLL_PWR = 0xC;
    while (!(PLL_CS & 1u << 31)) {
    }
    PLL_PRIM = 6u << 16 | 2u << 12;
    PLL_PWR = 4;
    CLK_SYS_CTRL = 1;
    while (!(CLK_SYS_SELECTED & 2u)) {
    }
    CLK_PERI_CTRL = 1u << 11;
    WATCHDOG_TICK = 12 | 1u << 9; /* of the timer, too: a microsecond */
}

static void reset(void)
{
    for (uint32_t *word = footsense_bss; word < footsense_bss_end; word++) {
        *word = 0;
    }
    start_clocks();
    GPIO_OUT_CLR = 0xFFFu << SDA;
    GPIO_OE_CLR = 0xFFFu << SDA;
    for (unsigned pin = SDA; pin < SDA + 2 * FOOTSENSE_LEGS; pin++) {
        PAD(pin) = PAD_I2C;
        PIN_CTRL(pin) = AS_GPIO;
    }
    PIN_CTRL(0) = AS_UART;
    PIN_CTRL(1) = AS_UART;
    UART_IBRD = 3; /* 125 MHz / 16 / 2 Mbit/s = 3 + 58 / 64 */
    UART_FBRD = 58;
    UART_LCR_H = 0x70; /* 8N1, with FIFOs */
    UART_CR = 0x301;
    UART_DMACR = 2;
    SYST_RVR = 0xFFFFFF;
    SYST_CVR = 0;
    SYST_CSR = 5;
    PSM_WDSEL = 0x1FFFC; /* all but the oscillators */
    WATCHDOG_LOAD = 2 * WATCHDOG_US;
    WATCHDOG_CTRL = 1u << 30;
    footsense_scan_start(&scan);
    for (;;) {
        footsense_scan_next(&scan);
    }
}

__attribute__((section(".vectors"), used)) static const struct {
    uint32_t *stack;
    void (*reset)(void);
} vectors = {footsense_stack_end, reset};
