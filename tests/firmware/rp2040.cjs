// Runs the image of an RP2040 in an emulator of that chip (rp2040js), with I2C chips at its pins that the program at the
// other end of standard input and output simulates: node rp2040.cjs IMAGE MICROSECONDS [LEG:CLOCKS ...], legs from 0 whose
// chips hold SDA low at first, for so many clocks.
//
// Messages, little endian: a letter, the leg, the time in ns as a double, a length and bytes. Answers: A (is there a chip at
// an address?) a byte, R (the next word) two bytes. W (written bytes), U (bytes on the serial line) and E (the end, with
// lines of the emulator's log) have none.
const fs = require("fs");
const { Simulator } = require("rp2040js");

const LEGS = 6, SDA = 2, SCL = 8;
const holds = new Map(process.argv.slice(4).map((text) => text.split(":").map(Number)));
const { clock, rp2040: mcu } = new Simulator();
const warnings = [];
mcu.logger = { debug() {}, info() {}, warn: (_, text) => warnings.push(text), error: (_, text) => warnings.push(text) };
mcu.flash.set(fs.readFileSync(process.argv[2]));
mcu.core.PC = 0x10000000;

function tell(what, leg, bytes) {
  const message = Buffer.alloc(11 + bytes.length);
  message.write(what, 0, "latin1");
  message[1] = leg;
  message.writeDoubleLE(clock.nanos, 2);
  message[10] = bytes.length;
  Buffer.from(bytes).copy(message, 11);
  fs.writeSync(1, message);
}

function ask(what, leg, bytes, n) {
  tell(what, leg, bytes);
  const answer = Buffer.alloc(n);
  for (let at = 0; at < n; at += fs.readSync(0, answer, at, n - at)) {}
  return answer;
}

class Bus {
  constructor(leg) {
    this.leg = leg;
    this.sda = this.scl = true;
    this.state = "idle"; // address, write, read
    this.bits = 0;
    this.byte = 0;
    this.written = [];
    this.word = [];
    this.holds = holds.get(leg) ?? 0;
    this.released = this.holds === 0;
    for (const pin of [SDA, SCL]) {
      mcu.gpio[pin + leg].setInputValue(pin === SCL || this.released);
      mcu.gpio[pin + leg].addListener(() => this.move());
    }
  }
  move() {
    const [sda, scl] = [SDA, SCL].map((pin) => mcu.gpio[pin + this.leg]);
    this.to(sda.value !== 0 && this.released, scl.value !== 0);
  }
  to(sda, scl) {
    const rose = scl && !this.scl, fell = !scl && this.scl, moved = sda !== this.sda;
    const held = scl && this.scl; // then a move of SDA is a start or a stop
    this.sda = sda;
    this.scl = scl;
    mcu.gpio[SDA + this.leg].setInputValue(sda);
    mcu.gpio[SCL + this.leg].setInputValue(scl);
    if (held && moved) this.edge(sda);
    else if (rose) this.sample(sda);
    else if (fell) this.drive();
  }
  edge(stop) {
    if (this.state === "write" && this.written.length) tell("W", this.leg, this.written);
    this.state = stop ? "idle" : "address";
    this.bits = this.byte = 0;
    this.written = [];
    this.word = [];
  }
  sample(sda) {
    if (this.state === "idle") return;
    if (this.bits < 8) this.byte = this.byte << 1 | (sda ? 1 : 0);
    this.bits++;
    if (this.bits === 9 && this.state === "read" && sda) this.state = "idle"; // not acknowledged: the last byte
  }
  drive() {
    let release = true; // whether the chip lets go of SDA
    if (this.holds) release = --this.holds === 0;
    if (this.bits === 8 && this.state !== "read") {
      if (this.state === "address") {
        this.reads = this.byte & 1;
        release = ask("A", this.leg, [this.byte >> 1], 1)[0] === 0;
        if (release) this.state = "idle";
      } else if (this.state === "write") {
        this.written.push(this.byte);
        release = false;
      }
    } else if (this.bits === 9) {
      this.bits = this.byte = 0;
      if (this.state === "address") this.state = this.reads ? "read" : "write";
    }
    if (this.state === "read" && this.bits < 8) {
      if (this.bits === 0) {
        if (!this.word.length) this.word = [...ask("R", this.leg, [], 2)];
        this.out = this.word.shift();
      }
      release = (this.out >> (7 - this.bits) & 1) === 1;
    }
    if (release !== this.released) {
      this.released = release;
      this.move();
    }
  }
}

for (let leg = 0; leg < LEGS; leg++) new Bus(leg);
mcu.uart[0].onByte = (byte) => tell("U", 0, [byte]);
const end = 1000 * Number(process.argv[3]);
while (clock.nanos < end) clock.tick(mcu.core.executeInstruction() * 1e9 / mcu.clkSys);
tell("E", 0, Buffer.from([...new Set(warnings)].join("\n").slice(0, 250)));
