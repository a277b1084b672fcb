/* The port of the scan to the test that calls it. */
#include "footsense_scan.h"

typedef struct {
    uint16_t (*transfer)(uint8_t legs, const uint8_t *out, uint8_t n_out, uint8_t *in, uint8_t n_in);
    uint32_t (*now_us)(void);
    void (*wait_until_us)(uint32_t t_us);
    void (*send)(const uint8_t *bytes, uint16_t n);
    int (*receive)(void);
} port;

static port to;
const char footsense_identity[] = "footsense mcu: AD7147, legs 1 to 6, native";
const unsigned native_scan_bytes = sizeof(footsense_scan), native_stages_bytes = sizeof(footsense_stages);

void native_bind(const port *given)
{
    to = *given;
}

footsense_answer footsense_transfer(uint8_t legs, const uint8_t *out, uint8_t n_out,
                                    uint8_t in[][FOOTSENSE_READ_MAX], uint8_t n_in)
{
    uint16_t answer = to.transfer(legs, out, n_out, in == 0 ? 0 : in[0], n_in);
    return (footsense_answer){(uint8_t)(answer & 0xFFu), (uint8_t)(answer >> 8)};
}

uint32_t footsense_now_us(void)
{
    return to.now_us();
}

void footsense_wait_until_us(uint32_t t_us)
{
    to.wait_until_us(t_us);
}

void footsense_send(const uint8_t *bytes, uint16_t n)
{
    to.send(bytes, n);
}

int footsense_receive(void)
{
    return to.receive();
}
