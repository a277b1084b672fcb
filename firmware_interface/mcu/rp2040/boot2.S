/* Second stage of the RP2040's start: reads of the flash by the command 03h, which every serial flash knows; then the program.
 * The boot ROM takes these 256 bytes if their checksum is right (`firmware_interface/mcu/uf2.py` writes it).
 *
 * Source: RP2040 data sheet, 2.8.1.3.1 (second stage), 4.10.13 (registers of the SSI). */
    .syntax unified
    .cpu cortex-m0plus
    .thumb
    .section .boot2, "ax"
    ldr r3, =0x18000000     /* XIP_SSI */
    movs r1, #0
    str r1, [r3, #0x08]     /* SSIENR: off */
    str r1, [r3, #0x04]     /* CTRLR1: one frame a read */
    movs r1, #4
    str r1, [r3, #0x14]     /* BAUDR: a quarter of the clock */
    ldr r1, =0x001F0300     /* 32 bits a frame, reads as of an EEPROM */
    str r1, [r3]            /* CTRLR0 */
    ldr r1, =0x03000218     /* command 03h of 8 bits, address of 24 */
    movs r2, #0xF4
    str r1, [r3, r2]        /* SPI_CTRLR0 */
    movs r1, #1
    str r1, [r3, #0x08]     /* SSIENR: on */
    ldr r0, =0x10000100     /* the program's vectors */
    ldr r1, =0xE000ED08     /* VTOR */
    str r0, [r1]
    ldmia r0, {r0, r1}
    msr msp, r0
    bx r1
    .ltorg
