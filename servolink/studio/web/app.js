// Starts the page: takes the token from the address, connects, and draws.

import { effect, html, render } from "./html.js";
import { Link } from "./link/link.js";
import { followTabs, TabLine } from "./link/tabs.js";
import { WorkerLine, watchPorts } from "./link/worker-line.js";
import { drawFigures } from "./parts/stage.js";
import { enterOnLeave, followTyping } from "./parts/typing.js";
import { App } from "./shell/app.js";
import { sayLease } from "./shell/control.js";
import { listenToKeys } from "./shell/keys.js";
import { followAddress } from "./shell/rail.js";
import { loadAll } from "./shell/screens.js";
import { isInPage, watched } from "./state/connecting.js";
import { followFigure, loadTemplates } from "./state/figure.js";
import { followFleet } from "./state/fleet.js";
import { followLibrary } from "./state/library.js";
import { Motion } from "./state/motion.js";
import { followMoves } from "./state/moving.js";
import { keepCurrent } from "./state/project.js";
import { followQuestions } from "./state/questions.js";
import { follow, welcome } from "./state/robot.js";
import { showLanguage, who } from "./state/settings.js";
import { followReach } from "./state/reach.js";
import { forWindow } from "./state/storage.js";
import { followTwin } from "./state/twin.js";

const KEY = "servolink.token";

/** Return the token, and remove one that the browser keeps from the address, against copies with the address. */
function takeToken() {
  const given = new URLSearchParams(location.hash.slice(1)).get("token");
  if (given && forWindow.set(KEY, given)) {
    window.history.replaceState(null, "", `${location.pathname}#live`);
  }
  return given ?? forWindow.get(KEY) ?? "";
}

const token = takeToken();
const scheme = location.protocol === "https:" ? "wss" : "ws";
const inPage = () => (watched ? new TabLine() : new WorkerLine());
const connect = () => (isInPage ? inPage() : new WebSocket(`${scheme}://${location.host}/ws`));
const link = new Link(connect, token, who.value);
const motion = new Motion(link);

// A new address in the place of an old one: the browser by itself would load nothing.
addEventListener("hashchange", () => location.hash.startsWith("#token=") && location.reload());

if (isInPage) watchPorts();
followTabs();
enterOnLeave();
followTyping();
followAddress();
follow(link, (notice, wasMine) => sayLease(notice, wasMine, motion));
followFigure(link);
followFleet(link);
followLibrary(link);
followMoves(link);
followTwin(link);
followReach(link);
followQuestions(link);
keepCurrent(link);
listenToKeys({ link, motion });
await Promise.all([loadTemplates(), showLanguage()]);
render(html`<${App} link=${link} motion=${motion} />`, /** @type {Element} */ (document.getElementById("app")));
drawFigures();
link.open();
effect(() => void (welcome.value && loadAll()));
