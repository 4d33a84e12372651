/* An emulated RP2040 with the image of the firmware, in emulated time: node bench.mjs IMAGE uart|usb CORE_HZ

   Reads a JSON object from each line of standard input and answers with one:
   {"uart": HEX, "usb": HEX, "pressed": [PIN], "battery": VOLTS, "erase": SECONDS, "run": SECONDS, "until": BYTES, "hang": true, "reset": true} ->
   {"uart": HEX, "usb": HEX, "open": BOOLEAN, "pulses": [[PIN, START, WIDTH]], "resets": N, "now": SECONDS, "stalls": N, "erasing": BOOLEAN}

   It runs for so many seconds, or until so many bytes have come. The emulator has no boot ROM and no flash that can be
   written: both are here. Its core may be slower than a real one, so that it costs less; timers, PWM, UART and USB have
   their real rates. */

import { readFileSync } from 'node:fs'
import { createInterface } from 'node:readline'
import { ConsoleLogger, LogLevel, RP2040, USBCDC } from 'rp2040js'

let eraseNanos = 45e6
const PROGRAM_NANOS = 0.4e6
const XIP = 0x10000000
const BOOT = 0x20041f00

/* Flash behind the SPI controller: commands, with the times that a W25Q16 takes. */
class Flash {
    constructor(chip) {
        this.chip = chip
        this.sent = null
        this.until = 0
        this.stalls = 0 // commands that came while it was busy
    }

    select(isSelected) {
        if (isSelected) this.sent = []
        else if (this.sent) {
            this.finish(this.sent)
            this.sent = null
        }
    }

    isErasing() {
        return this.chip.clock.nanos + PROGRAM_NANOS < this.until
    }

    exchange(byte) {
        this.sent.push(byte)
        const [command, high, middle, low] = this.sent
        const isBusy = this.chip.clock.nanos < this.until
        if (command === 0x05) return isBusy ? 1 : 0
        if (command === 0x4b) return this.sent.length
        if (command === 0x03 && this.sent.length > 4) {
            if (isBusy) this.stalls++
            return this.chip.flash[((high << 16) | (middle << 8) | low) + this.sent.length - 5]
        }
        return 0xff
    }

    finish([command, high, middle, low, ...data]) {
        const at = (high << 16) | (middle << 8) | low
        if (command === 0x06) this.isEnabled = true
        if (command !== 0x02 && command !== 0x20) return
        if (this.chip.clock.nanos < this.until || !this.isEnabled) this.stalls++
        this.isEnabled = false
        if (command === 0x20) this.chip.flash.fill(0xff, at, at + 4096)
        else data.forEach((byte, index) => (this.chip.flash[(at & ~0xff) | ((at + index) & 0xff)] &= byte))
        this.until = this.chip.clock.nanos + (command === 0x20 ? eraseNanos : PROGRAM_NANOS)
    }
}

class Register {
    constructor(read, write) {
        this.readUint32 = read
        this.write = write
    }

    writeUint32Atomic(offset, value) {
        this.write(offset, value)
    }
}

function load(chip, path) {
    const blocks = readFileSync(path)
    for (let at = 0; at < blocks.length; at += 512) {
        chip.flash.set(blocks.subarray(at + 32, at + 32 + 256), blocks.readUInt32LE(at + 12) - XIP)
    }
}

const image = process.argv[2]
const hasUsb = process.argv[3] === 'usb'
const cycle = 1e9 / Number(process.argv[4]) // nanoseconds
let chip, flash, cdc
let seen = { uart: [], usb: [], pulses: [], resets: 0, open: false }
const started = new Map()
const { clock } = new RP2040()

/* Switch on, or reset: what the boot ROM does. The flash keeps what it has. */
function boot(kept) {
    clock.nextAlarm = null
    chip = new RP2040(clock)
    chip.logger = new ConsoleLogger(LogLevel.Error)
    if (kept) chip.flash.set(kept)
    else load(chip, image)
    flash = new Flash(chip)
    let answer = 0
    chip.peripherals[0x18000] = new Register(
        (offset) => (offset === 0x28 ? 8 : offset === 0x60 ? answer : 0),
        (offset, value) => (answer = offset === 0x60 && flash.sent ? flash.exchange(value & 0xff) : answer)
    )
    chip.peripherals[0x40018] = new Register(() => 0, (offset, value) => offset === 0x0c && flash.select(value === 2 << 8))
    const watchdog = chip.peripherals[0x40058]
    watchdog.onWatchdogTrigger = () => {
        watchdog.alarm.enable = false // or it would fire without end
        seen.isReset = true
    }
    chip.uart[0].onByte = (byte) => seen.uart.push(byte)
    if (hasUsb) {
        cdc = new USBCDC(chip.usbCtrl)
        cdc.onDeviceConnected = () => (seen.open = true)
        cdc.onSerialData = (bytes) => seen.usb.push(...bytes)
    }
    seen.open = false
    for (const pin of chip.gpio.slice(16)) pin.setInputValue(true)
    chip.gpio.slice(0, 16).forEach((pin, index) => {
        if (started.has(index)) end(index)
        pin.addListener((state) => {
            if (state === 1) started.set(index, clock.nanos)
            else if (started.has(index)) end(index)
        })
    })
    chip.sram.set(chip.flash.subarray(0, 256), BOOT - 0x20000000)
    chip.core.PC = BOOT
}

function end(pin) {
    const start = started.get(pin)
    started.delete(pin)
    seen.pulses.push([pin, start / 1e9, (clock.nanos - start) / 1e3])
}

function run(seconds, most = Infinity) {
    const until = clock.nanos + seconds * 1e9
    while (clock.nanos < until && seen.uart.length + seen.usb.length < most) {
        clock.tick(chip.core.executeInstruction() * cycle)
        if (seen.isReset) {
            seen.isReset = false
            seen.resets++
            boot(chip.flash)
        }
    }
}

boot()
for await (const line of createInterface({ input: process.stdin })) {
    const asked = JSON.parse(line)
    if (asked.erase) eraseNanos = asked.erase * 1e9
    if (asked.reset) boot(chip.flash)
    if (asked.hang) chip.sramView.setUint32((chip.core.PC & ~3) - 0x20000000, 0xe7fee7fe, true) // branches to itself
    if (asked.pressed) chip.gpio.slice(16).forEach((pin) => pin.setInputValue(!asked.pressed.includes(pin.index)))
    if (asked.battery !== undefined) chip.adc.channelValues[0] = Math.round((asked.battery / 3.3) * 4095)
    for (const byte of Buffer.from(asked.usb ?? '', 'hex')) cdc.sendSerialByte(byte)
    for (const byte of Buffer.from(asked.uart ?? '', 'hex')) {
        chip.uart[0].feedByte(byte)
        run(10 / 115200)
    }
    run(asked.run ?? 0, asked.until)
    const hex = (bytes) => Buffer.from(bytes).toString('hex')
    const { open, pulses, resets } = seen
    const answer = { uart: hex(seen.uart), usb: hex(seen.usb), open, pulses, resets, now: clock.nanos / 1e9, stalls: flash.stalls, erasing: flash.isErasing() }
    console.log(JSON.stringify(answer))
    Object.assign(seen, { uart: [], usb: [], pulses: [] })
}
