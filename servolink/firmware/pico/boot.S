/* The first 256 bytes of flash, which the boot ROM copies to 0x20041f00 and runs: copies the image to RAM and starts it.
   From then on nothing is read from flash by its address, so it may be busy. */

    .syntax unified
    .cpu cortex-m0plus
    .thumb
    .section .boot, "ax"
    .global boot
    .thumb_func
boot:
    ldr r3, =0x18000000     @ SSI
    movs r1, #0
    str r1, [r3, #0x08]     @ SSIENR: off
    movs r0, #4
    str r0, [r3, #0x14]     @ BAUDR
    ldr r0, =0x001f0300     @ 32 bits of data, EEPROM read
    str r0, [r3, #0x00]     @ CTRLR0
    str r1, [r3, #0x04]     @ CTRLR1: one word
    ldr r2, =0x180000f4
    ldr r0, =0x03000218     @ command 03, address of 24 bits, one data line
    str r0, [r2]            @ SPI_CTRLR0
    movs r0, #1
    str r0, [r3, #0x10]     @ SER
    str r0, [r3, #0x08]     @ SSIENR: on
    ldr r0, =image_in_flash
    ldr r1, =image_start
    ldr r2, =image_end
copy:
    ldmia r0!, {r3}
    stmia r1!, {r3}
    cmp r1, r2
    blo copy
    ldr r0, =image_start    @ the vectors
    ldr r1, =0xe000ed08     @ VTOR
    str r0, [r1]
    ldmia r0!, {r1, r2}
    msr msp, r1
    bx r2
    .ltorg
