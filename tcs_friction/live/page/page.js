// The page: one WebSocket, what it says into plots and panels, what is clicked back to the server.

import { Plots, Store } from "/page/plots.js";
import * as panels from "/page/panels.js";

const $ = (id) => document.getElementById(id);
const AGAIN = 1000; // ms after which a lost connection is tried again
const SILENT = 4000; // ms without a word after which a connection counts as lost, though nothing has closed it
const store = new Store();
const plots = new Plots(store, zoom, live);
let socket = null;
let hello = null;
let status = {};
let frames = 0;
let heard = 0; // ms, when the server was heard last
let chosen = new URLSearchParams(location.search).get("axis") ?? "";
// What is asked before an order is given, "" for nothing.
const questions = {
  commission: () => "moves the axis by itself for some minutes, as far and as fast as its reference files say. Is it free to move?",
  compensate: () =>
    status.mode !== "compensate" && status.numbers?.reference_speed
      ? "switches the compensation on while the axis is tracking. The torque has no step; an error of its friction parameters acts on the tracking at once. Switch it on now?"
      : "",
};

function connect() {
  heard = performance.now();
  socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/live/${encodeURIComponent(chosen)}`);
  socket.onmessage = (event) => {
    heard = performance.now();
    requestAnimationFrame(() => take(JSON.parse(event.data)));
  };
  socket.onclose = lost;
}

function lost() {
  status = {};
  panels.showHeadline({ level: "wrong", state: "Page lost", sentence: "The page's server does not answer. It is tried again every second." });
  setTimeout(connect, AGAIN);
}

// A cable that is pulled and a server that hangs close nothing. A hidden page draws nothing, so it is sent nothing.
function watch() {
  if (document.hidden || performance.now() - heard < SILENT) return;
  heard = Infinity;
  socket.onmessage = socket.onclose = null;
  socket.close();
  lost();
}

function send(message) {
  if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
}

function take(message) {
  if (message.hello) return greet(message.hello);
  send({ drawn: 1 });
  if (message.status) showStatus(message.status);
  if (message.told !== undefined) panels.tell(message.told);
  if (message.zoom && plots.held) plots.hold([message.zoom.begin, message.zoom.end], message.zoom.curves);
  if (message.frame.clear) live();
  store.add(message.frame);
  plots.draw(frames++ % 5 === 0 && plots.held === null);
}

function greet(message) {
  const first = hello === null;
  hello = message;
  document.title = `${hello.axis}: tcs_friction`;
  store.clear();
  plots.held = null;
  showAxes();
  panels.makeNumbers(hello.units);
  plots.make(hello.units);
  if (first) $("lengths").append(...hello.windows.map(windowButton));
  send({ window: windowLength() });
}

function windowButton(seconds) {
  const button = document.createElement("button");
  button.textContent = `${seconds} s`;
  button.dataset.window = seconds;
  button.setAttribute("aria-pressed", String(seconds === 20));
  button.addEventListener("click", () => {
    for (const other of $("lengths").children) other.setAttribute("aria-pressed", String(other === button));
    live();
    send({ window: seconds });
  });
  return button;
}

function windowLength() {
  return Number(document.querySelector("#lengths [aria-pressed=true]").dataset.window);
}

function showAxes() {
  if (hello.axes.length === 1) {
    $("axis").textContent = hello.axis;
    return;
  }
  const select = document.createElement("select");
  select.setAttribute("aria-label", "axis");
  select.append(...hello.axes.map((name) => new Option(name, name, false, name === hello.axis)));
  select.addEventListener("change", () => {
    chosen = select.value;
    socket.close();
  });
  $("axis").replaceChildren(select);
}

function showStatus(changed) {
  status = { ...status, ...changed };
  if (changed.headline) panels.showHeadline(status.headline);
  if (changed.numbers) panels.showNumbers(status.numbers);
  if (changed.nodes) panels.showNodes(status.nodes, hello.columns);
  if (["switches", "effects", "model", "control", "job"].some((name) => name in changed)) panels.showSwitches(status, (name, on) => give({ effect: [name, on] }));
  if (changed.job || changed.control !== undefined || changed.mode !== undefined) panels.showJob(status.job, status.control, status.mode);
  if (changed.results) panels.showResults(status.results, hello.axis);
}

function zoom(range) {
  plots.hold(range, null);
  $("live").hidden = false;
  send({ zoom: range });
}

function live() {
  if (plots.held) plots.hold(null, null);
  $("live").hidden = true;
}

async function order(button) {
  const name = button.dataset.order;
  const question = questions[name]?.();
  if (question && !(await confirmed(button.textContent, question))) return;
  give({ order: name });
}

function give(order) {
  panels.tell("");
  send(order);
}

function confirmed(name, question) {
  $("confirm-name").textContent = name;
  $("confirm-question").textContent = question;
  $("confirm").returnValue = "no";
  $("confirm").showModal();
  return new Promise((done) => $("confirm").addEventListener("close", () => done($("confirm").returnValue === "yes"), { once: true }));
}

for (const button of document.querySelectorAll("[data-order]")) button.addEventListener("click", () => order(button));
$("live").addEventListener("click", live);
document.addEventListener("visibilitychange", () => (heard = performance.now()));
setInterval(watch, AGAIN);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => hello && plots.make(hello.units));
connect();
