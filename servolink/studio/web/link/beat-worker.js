// Ticks every 100 ms. Timers of a page in the background are slowed down, those of a worker are not.

const PERIOD = 100; // milliseconds

setInterval(() => postMessage(0), PERIOD);
