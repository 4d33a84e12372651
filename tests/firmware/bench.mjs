/* An emulated RP2040 with the image of the firmware, in emulated time: node bench.mjs IMAGE uart|usb CORE_HZ

   Reads a JSON object from each line of standard input and answers with one:
   {"uart": HEX, "usb": HEX, "pressed": [PIN], "battery": VOLTS, "erase": SECONDS, "run": SECONDS, "until": BYTES,
    "hang": true, "reset": true, "cut": RANDOM, "power": BOOLEAN, "asleep": BOOLEAN, "setup": HEX, "data": HEX} ->
   {"uart": HEX, "usb": HEX, "open": BOOLEAN, "pulses": [[PIN, START, WIDTH]], "resets": N, "now": SECONDS, "stalls": N,
    "erasing": BOOLEAN, "busy": BOOLEAN, "longest": INSTRUCTIONS, "control": HEX or null}

   `cut` switches off and on in the middle of what flash does; `power` and `asleep` are of the USB host, which sends its
   request `setup` to endpoint 0: `control` is the answer, null if it is refused. `longest` is the most instructions
   between two times at which the firmware read the clock, as its loop does once in each turn.

   It runs for so many seconds, or until so many bytes have come. The emulator has no boot ROM and no flash that can be
   written: both are here. Its core may be slower than a real one, so that it costs less; timers, PWM, UART and USB have
   their real rates. */

import { readFileSync } from 'node:fs'
import { createInterface } from 'node:readline'
import { ConsoleLogger, LogLevel, RP2040, USBCDC } from 'rp2040js'

let eraseNanos = 45e6
const PROGRAM_NANOS = 0.4e6
const XIP = 0x10000000
const SUSPENDED = 1 << 4
const STALL = 1 << 11
const VBUS_PIN = 24
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

    isBusy() {
        return this.chip.clock.nanos < this.until
    }

    isErasing() {
        return this.chip.clock.nanos + PROGRAM_NANOS < this.until
    }

    /* Power is lost: what goes on stays half done. */
    cut(random) {
        if (!this.isBusy()) return
        const { at, bytes } = this.before
        bytes.forEach((old, index) => {
            random = (Math.imul(random, 1664525) + 1013904223) >>> 0
            const done = this.chip.flash[at + index]
            const noise = random >>> 24
            if (this.before.isErase) this.chip.flash[at + index] = old | noise // some bits are erased
            else if (noise & 3) this.chip.flash[at + index] = noise & 4 ? done : old // most bytes wholly
            else this.chip.flash[at + index] = old & (done | noise)
        })
    }

    exchange(byte) {
        this.sent.push(byte)
        const [command, high, middle, low] = this.sent
        const isBusy = this.isBusy()
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
        if (this.isBusy() || !this.isEnabled) this.stalls++
        this.isEnabled = false
        const start = command === 0x20 ? at : at & ~0xff
        this.before = { at: start, isErase: command === 0x20, bytes: this.chip.flash.slice(start, start + (command === 0x20 ? 4096 : 256)) }
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
let isAsleep = false
let turn = 0 // instructions since the clock was read
let transfer = null // control transfer of ours, not of the emulator's host
let seen = { uart: [], usb: [], pulses: [], resets: 0, open: false, longest: 0 }
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
    const timer = chip.peripherals[0x40054]
    const readTimer = timer.readUint32.bind(timer)
    timer.readUint32 = (offset) => {
        if (offset === 0x28 && watchdog.alarm.enable) seen.longest = Math.max(seen.longest, turn)
        if (offset === 0x28) turn = 0
        return readTimer(offset)
    }
    if (hasUsb) startHost()
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

/* The emulator's host opens the port. Ours sends single requests to endpoint 0, and is what frames and sleep come from. */
function startHost() {
    const { usbCtrl } = chip
    cdc = new USBCDC(usbCtrl)
    cdc.onDeviceConnected = () => (seen.open = true)
    cdc.onSerialData = (bytes) => seen.usb.push(...bytes)
    const { onEndpointWrite, onEndpointRead } = usbCtrl
    usbCtrl.onEndpointWrite = (endpoint, bytes) => {
        if (endpoint || !transfer) onEndpointWrite(endpoint, bytes)
        else transfer.push(...bytes)
    }
    usbCtrl.onEndpointRead = (endpoint, size) => {
        if (endpoint || !transfer?.data) onEndpointRead(endpoint, size)
        else usbCtrl.endpointReadDone(0, transfer.data)
    }
    const write = usbCtrl.writeUint32.bind(usbCtrl)
    usbCtrl.writeUint32 = (offset, value) => {
        write(offset, value)
        if (offset === 0x50) usbCtrl.sieStatus &= ~(usbCtrl.rawWriteValue & SUSPENDED)
    }
}

const control = (endpoint) => chip.usbDPRAMView.getUint32(0x80 + endpoint, true)

/* Send a request to endpoint 0, and return the bytes of the answer; null if it is refused. */
function ask(setup, data) {
    transfer = Object.assign([], { data: data && Buffer.from(data, 'hex') })
    chip.usbDPRAMView.setUint32(0x80, 0, true)
    chip.usbCtrl.sendSetupPacket(Buffer.from(setup, 'hex'))
    run(0.002)
    const answer = control(0) & STALL ? null : Buffer.from(transfer).toString('hex')
    transfer = null
    return answer
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
        turn++
        if (!isAsleep) chip.usbCtrl.sofFrameNumber = clock.nanos / 1e6
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
    if (asked.cut !== undefined) flash.cut(asked.cut)
    if (asked.reset || asked.cut !== undefined) boot(chip.flash)
    if (asked.power !== undefined) chip.gpio[VBUS_PIN].setInputValue(asked.power)
    if (asked.asleep !== undefined) isAsleep = asked.asleep
    if (asked.asleep) chip.usbCtrl.sieStatus |= SUSPENDED
    const answered = asked.setup ? ask(asked.setup, asked.data) : null
    if (asked.hang) chip.sramView.setUint32((chip.core.PC & ~3) - 0x20000000, 0xe7fee7fe, true) // branches to itself
    if (asked.pressed) chip.gpio.slice(16).forEach((pin) => pin.setInputValue(!asked.pressed.includes(pin.index)))
    if (asked.battery !== undefined) chip.adc.channelValues[0] = Math.round((asked.battery / 3.3) * 4095)
    for (const byte of Buffer.from(asked.usb ?? '', 'hex')) {
        while (cdc.txFIFO.itemCount >= 64) run(1e-6)
        cdc.sendSerialByte(byte)
    }
    for (const byte of Buffer.from(asked.uart ?? '', 'hex')) {
        chip.uart[0].feedByte(byte)
        run(10 / 115200)
    }
    run(asked.run ?? 0, asked.until)
    const hex = (bytes) => Buffer.from(bytes).toString('hex')
    const { open, pulses, resets, longest } = seen
    const rest = { now: clock.nanos / 1e9, stalls: flash.stalls, erasing: flash.isErasing(), busy: flash.isBusy(), control: answered }
    console.log(JSON.stringify({ uart: hex(seen.uart), usb: hex(seen.usb), open, pulses, resets, longest, ...rest }))
    Object.assign(seen, { uart: [], usb: [], pulses: [], longest: 0 })
}
