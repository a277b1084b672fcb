/* The firmware on an emulated Cortex-M: QEMU's machine lm3s6965evb. Its port asks a program beside the emulator for
 * everything, time included, which passes in transactions and waits alone: so chips that are simulated there see what they
 * would see of a real controller. The way there are two pipes in its folder, through semihosting.
 *
 * A transaction, a wait and a sending are a letter and their arguments, little endian; the answer of the first two begins
 * with the time. What the processor has executed and the deepest stack go along with what is sent.
 *
 * Source: Arm, Semihosting for AArch32 and AArch64; ARMv7-M architecture reference manual, SysTick. */
#include "../footsense_scan.h"

#define REGISTER(address) (*(volatile uint32_t *)(address))
#define SYST_CSR REGISTER(0xE000E010u)
#define SYST_RVR REGISTER(0xE000E014u)
#define SYST_CVR REGISTER(0xE000E018u)

enum { SYS_OPEN = 1, SYS_WRITE = 5, SYS_READ = 6, MODE_READ = 1, MODE_WRITE = 5 };

extern uint32_t footsense_stack_end[], footsense_stack[];
static const uint32_t PAINT = 0xA5A5A5A5u;

const char footsense_identity[] = "footsense mcu: AD7147, legs 1 to 6, emulated Cortex-M";

static uint32_t left_at, ticks; /* when the scan went on, and how long it took since the last sending */
static uint32_t now_us, from, to;
static int received = -1;

static uint32_t host(uint32_t what, uint32_t a, uint32_t b, uint32_t c)
{
    uint32_t arguments[3] = {a, b, c};
    register uint32_t r0 __asm__("r0") = what;
    register uint32_t *r1 __asm__("r1") = arguments;
    __asm__ volatile("bkpt #0xAB" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

static void get(void *into, uint32_t n)
{
    for (uint32_t left = n; left != 0;) {
        left = host(SYS_READ, from, (uint32_t)into + n - left, left);
    }
}

static void put(const void *bytes, uint32_t n)
{
    (void)host(SYS_WRITE, to, (uint32_t)bytes, n);
}

static void enter(void)
{
    ticks += (left_at - SYST_CVR) & 0xFFFFFFu; /* it counts down */
}

static void leave(void)
{
    left_at = SYST_CVR;
}

footsense_answer footsense_transfer(uint8_t legs, const uint8_t *out, uint8_t n_out,
                                    uint8_t in[][FOOTSENSE_READ_MAX], uint8_t n_in)
{
    enter();
    const uint8_t head[4] = {'T', legs, n_out, n_in};
    footsense_answer answer;
    put(head, sizeof head);
    put(out, n_out);
    get(&now_us, sizeof now_us);
    get(&answer, sizeof answer);
    for (unsigned leg = 0; leg < FOOTSENSE_LEGS; leg++) {
        if (n_in != 0 && (answer.answered >> leg & 1u)) {
            get(in[leg], n_in);
        }
    }
    leave();
    return answer;
}

uint32_t footsense_now_us(void)
{
    return now_us;
}

void footsense_wait_until_us(uint32_t t_us)
{
    enter();
    put("W", 1);
    put(&t_us, sizeof t_us);
    get(&now_us, sizeof now_us);
    get(&received, sizeof received);
    leave();
}

void footsense_send(const uint8_t *bytes, uint16_t n)
{
    enter();
    const uint32_t *deepest = footsense_stack;
    while (*deepest == PAINT) {
        deepest++;
    }
    uint32_t head[3] = {ticks, (uint32_t)footsense_stack_end - (uint32_t)deepest, n};
    put("S", 1);
    put(head, sizeof head);
    put(bytes, n);
    ticks = 0;
    leave();
}

int footsense_receive(void)
{
    int byte = received;
    received = -1;
    return byte;
}

static footsense_scan scan;

static void run(void)
{
    SYST_RVR = 0xFFFFFFu;
    SYST_CVR = 0;
    SYST_CSR = 5; /* on, by the processor's clock */
    from = host(SYS_OPEN, (uint32_t)"to_mcu", MODE_READ, 6);
    to = host(SYS_OPEN, (uint32_t)"from_mcu", MODE_WRITE, 8);
    footsense_wait_until_us(0);
    footsense_scan_start(&scan);
    for (;;) {
        footsense_scan_next(&scan);
    }
}

/* The stack is painted, to see how deep it gets; the RAM of the emulator is zero. */
static void reset(void)
{
    for (uint32_t *word = footsense_stack; word < (uint32_t *)__builtin_frame_address(0) - 8; word++) {
        *word = PAINT;
    }
    run();
}

__attribute__((section(".vectors"), used)) static const struct {
    uint32_t *stack;
    void (*reset)(void);
} vectors = {footsense_stack_end, reset};
