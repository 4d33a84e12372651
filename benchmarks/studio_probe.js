// What the page of the studio does, measured in it: times of frames, inputs and beats, milliseconds of performance.now().

window.probe = { readings: [], beats: [], inputs: [], drags: [] };

{
  const Socket = window.WebSocket;
  window.WebSocket = class extends Socket {
    constructor(...args) {
      super(...args);
      this.addEventListener("message", ({ data }) => {
        const reading = /^\{"jsonrpc":"2.0","method":"servos".*"missed":(\d+)/.exec(data);
        if (reading) window.probe.readings.push([performance.now(), Number(reading[1])]);
      });
    }

    send(text) {
      if (text.includes('"lease.beat"')) window.probe.beats.push(performance.now());
      super.send(text);
    }
  };
}

addEventListener("input", (event) => window.probe.inputs.push([event.timeStamp, Number(event.target.value)]), true);

// A drag is done when the next frame is on the screen: a task behind its animation frame runs when it was handed over.
addEventListener("pointermove", (event) => {
  if (event.buttons === 0) return;
  requestAnimationFrame(() => {
    const { port1, port2 } = new MessageChannel();
    port1.onmessage = () => window.probe.drags.push(performance.now() - event.timeStamp);
    port2.postMessage(0);
  });
}, true);
