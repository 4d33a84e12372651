// Moves servo 1 of a shared board, and prints meanwhile what all servos report: node watch.mjs rex
import net from "node:net";
import readline from "node:readline";

const socket = net.connect(`${process.env.XDG_RUNTIME_DIR}/servolink/${process.argv[2]}.sock`);
const send = (message) => socket.write(JSON.stringify(message) + "\n");

send({ servolink: 1, wants: "rpc", who: "watch.mjs", role: "move" });

readline.createInterface({ input: socket }).on("line", (line) => {
  if (socket.writableEnded) return; // these had arrived before the end
  const { servolink, error, id, method, params } = JSON.parse(line);
  if (error) throw new Error(error.message ?? error);
  if (servolink) {
    send({ jsonrpc: "2.0", id: 1, method: "servos.watch", params: { hz: 10 } });
    send({ jsonrpc: "2.0", id: 2, method: "move", params: { targets: { 1: 60 }, duration: 0.5, wait: true } });
  } else if (method === "servos") {
    console.log(params.servos.map((servo) => servo.angle).join(" "));
    send({ jsonrpc: "2.0", method: "servos.ack", params: { number: params.number } });
  } else if (id === 2) {
    socket.end(); // the servo has arrived
  }
});
