// Everything but the plots. Whatever comes from the graph or from a file's name is put in as text, never as markup.

const $ = (id) => document.getElementById(id);
const NUMBERS = [
  ["error_rms", "tracking error, rms of 5 s", "error"],
  ["position", "position", "position"],
  ["speed", "speed", "speed"],
  ["torque", "torque applied", "torque"],
  ["friction_estimate", "friction, observer", "torque"],
  ["friction_compensation", "friction, compensator", "torque"],
];
const SWITCHES = ["Switch1 observer", "Switch2 identification listens", "Switch3 compensation"];
const LEVELS = [["is-well", "well"], ["is-warning", "warning"], ["is-wrong", "error"], ["is-wrong", "stale"]];

function element(kind, text, kinds) {
  const made = document.createElement(kind);
  if (text !== undefined) made.textContent = text;
  if (kinds) made.className = kinds;
  return made;
}

export function makeNumbers(units) {
  $("numbers").replaceChildren(...NUMBERS.map(([name, label, unit]) => {
    const card = element("div", undefined, "number");
    const value = element("b", "–");
    value.id = `number-${name}`;
    card.append(element("span", label), value, " ", element("i", units[unit]));
    return card;
  }));
  for (const place of document.querySelectorAll("[data-unit]")) place.textContent = `[${units[place.dataset.unit]}]`;
}

export function showNumbers(numbers) {
  for (const [name] of NUMBERS) {
    const value = numbers[name];
    $(`number-${name}`).textContent = value === null || value === undefined ? "–" : significant(value);
  }
}

function significant(value) {
  const text = Math.abs(value) >= 1e-3 || value === 0 ? String(Number(value.toPrecision(4))) : value.toExponential(2);
  return text.replaceAll("-", "−");
}

export function showHeadline({ level, state, sentence }) {
  $("headline").className = level;
  if ($("state").textContent !== state) $("state").textContent = state;
  $("sentence").textContent = sentence;
}

// An effect that the compensator's model has is a switch of its own; set: what a click on it does.
export function showSwitches({ switches, model, effects, control, job }, set) {
  $("switches").replaceChildren(...SWITCHES.map((name, i) => {
    const is = switches[i];
    return element("span", `${name}: ${is === null ? "not known" : is ? "on" : "off"}`, `chip ${is === null ? "unknown" : is ? "on" : ""}`);
  }));
  const chips = effects.map(({ name, state, asked }) => {
    const chip = element(asked === null ? "span" : "button", `${name.replaceAll("_", " ")}: ${state}`, `chip ${state === "cancelled" ? "on" : ""}`);
    if (asked === null) return chip;
    chip.title = asked ? "Leave it out" : "Cancel it";
    chip.setAttribute("role", "switch");
    chip.setAttribute("aria-checked", String(asked));
    chip.disabled = !control || job.running;
    chip.addEventListener("click", () => set(name, !asked));
    return chip;
  });
  if (model) chips.unshift(element("span", `model: ${model}`, "chip"));
  $("effects").replaceChildren(...(chips.length ? chips : [element("span", "The axis file names no effects beyond friction.", "hint")]));
}

export function showNodes(nodes, columns) {
  const head = element("tr");
  head.append(...["node", "state"].map((name) => element("th", name)), ...["reported before [s]", ...columns, "oldest input [s]"].map((name) => element("th", name, "n")), element("th", "says"));
  const rows = nodes.map((node) => {
    const line = element("tr");
    const [kind, word] = node.silent ? ["is-wrong", "silent"] : LEVELS[Math.min(node.level, 3)];
    line.append(element("td", node.name), element("td", word, `state ${kind}`), element("td", node.age.toFixed(node.silent ? 0 : 1), "n"));
    line.append(...node.values.map((value) => element("td", value || "–", "n")), element("td", node.inputs === null ? "–" : node.inputs.toFixed(3), "n"));
    line.append(element("td", node.message, "message"));
    line.title = Object.entries(node.all).map(([key, value]) => `${key}: ${value}`).join("\n");
    return line;
  });
  $("nodes").replaceChildren(head, ...rows);
}

export function showJob(job, control, mode) {
  $("job").hidden = !job.name;
  $("job").className = job.success === false ? "failed" : "";
  $("progress").hidden = !job.running;
  if (job.running && job.progress === 0) $("progress").removeAttribute("value");
  else $("progress").value = job.progress;
  if (job.name) $("job-name").textContent = job.running ? `${job.name} …` : `${job.name}: ${job.success ? "done" : "failed"}.`;
  $("job-stage").textContent = job.running && job.progress ? `${job.stage} (${Math.round(100 * job.progress)} %)` : job.stage;
  for (const button of document.querySelectorAll("[data-order]")) {
    const order = button.dataset.order;
    button.disabled = !control || (order === "abort" ? false : job.running);
    button.setAttribute("aria-pressed", String(order === mode));
  }
  if (!control) tell("This page may only look: the server runs without --control.");
}

export function tell(text) {
  $("told").hidden = !text;
  $("told").textContent = text;
}

export function showResults(results, axis) {
  const lines = results.map(({ path, kind, bytes, time }) => {
    const line = element("li");
    line.append(element("span", path, "name"), element("span", `${kind}, ${size(bytes)}, ${new Date(1000 * time).toLocaleString()}`, "about"));
    const button = element("button", "Open");
    button.addEventListener("click", () => open(path, kind, axis));
    line.append(button);
    return line;
  });
  $("results").replaceChildren(...(lines.length ? lines : [element("li", "None yet below the results directory.", "hint")]));
}

function open(path, kind, axis) {
  const place = path.split("/").map(encodeURIComponent).join("/");
  $("reader-name").textContent = path;
  $("reader-frame").src = `/${kind === "recording" ? "recordings" : "results"}/${encodeURIComponent(axis)}/${place}`;
  $("reader").hidden = false;
  $("reader").scrollIntoView({ behavior: "smooth" });
}

$("reader-close").addEventListener("click", () => {
  $("reader").hidden = true;
  $("reader-frame").src = "about:blank";
});

function size(bytes) {
  const steps = ["B", "kB", "MB", "GB"];
  const step = Math.min(3, Math.floor(Math.log10(Math.max(bytes, 1)) / 3));
  return `${(bytes / 1000 ** step).toPrecision(3)} ${steps[step]}`;
}
