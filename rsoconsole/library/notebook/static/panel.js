// The live panel's page. It only puts in place what the kernel tells and sends what is pressed;
// nothing is fetched from anywhere. All words are set as text; the drawings are the kernel's own.

const HERE_MS = 2000;
const NO_ANSWER_MS = 700;
const STOP_TIMES = 10;
const OLD_MS = 3500;
const TYPED_MS = 350;
const CLI = "run 'rsoconsole stop' in a terminal, or cut the mount's power";

function make(tag, properties = {}, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name.startsWith("aria-") || name === "role" || name === "for" || name === "list") {
      node.setAttribute(name, value);
    } else {
      node[name] = value;
    }
  }
  node.append(...children);
  return node;
}

function button(text, onclick, className = "") {
  return make("button", { type: "button", textContent: text, onclick, className });
}

// Leaves alone what has not changed: focus stays, and readers are told only of news.
function put(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

function rows(list, values, fill) {
  while (list.children.length > values.length) list.lastChild.remove();
  values.forEach((value, n) => {
    const key = JSON.stringify(value);
    let item = list.children[n];
    if (!item) list.append((item = make("li")));
    if (item.dataset.key !== key) {
      item.dataset.key = key;
      item.replaceChildren();
      item.className = "";
      fill(item, value);
    }
  });
}

function render({ model, el }) {
  const send = (kind, more = {}) => model.send({ kind, ...more });
  const order = (verb, args = {}) => send("order", { verb, arguments: args });
  const timers = new Set();
  let seenMs = Date.now();

  // -- the frame of it ------------------------------------------------------------------------
  const state = make("span", { className: "rso-state" });
  const holder = make("span", { className: "rso-holder" });
  const clock = make("span", { className: "rso-clock" });
  const stop = button("STOP", pressStop, "rso-stop");
  stop.setAttribute("aria-label", "STOP the telescope now");
  const words = make("div", { className: "rso-words", role: "status", "aria-live": "polite" },
    make("div", {}, state, " ", holder), clock);
  const banner = make("div", { className: "rso-banner", role: "alert" });
  const alerts = make("ul", { className: "rso-alerts", role: "alert" });
  const dialog = make("div", { className: "rso-dialog", hidden: true, role: "group" });
  const said = make("div", { className: "rso-said", role: "status", "aria-live": "polite" });

  const image = make("img", { className: "rso-image", alt: "the newest frame", hidden: true });
  const overlay = make("div", { className: "rso-overlay" });
  const caption = make("figcaption");
  const figure = make("figure", {},
    make("div", { className: "rso-sky" }, image, overlay), caption);
  const plots = {};
  const drawn = make("div", { className: "rso-plots" });
  for (const [name, title] of [["confidence", "confidence, τ dashed"],
    ["east", "residual Δα cos δ (″), 3 σ dashed"], ["north", "residual Δδ (″), 3 σ dashed"],
    ["nis", "NIS, 95 % band"]]) {
    plots[name] = make("div");
    drawn.append(make("div", { className: "rso-plot" }, make("div", { textContent: title }), plots[name]));
  }
  const facts = make("ul", { className: "rso-facts", "aria-label": "where it looks" });
  const health = make("ul", { className: "rso-health", "aria-label": "instruments" });
  const log = make("ul", { className: "rso-log", "aria-label": "log, the newest first" });

  // -- what can be pressed --------------------------------------------------------------------
  const arm = button("Arm", () => order(status().is_autonomous ? "disarm" : "arm"));
  const hold = button("Hold", () => order(status().wants_resuming ? "resume" : "hold"));
  const where = make("input", { type: "text", className: "rso-where", spellcheck: false,
    placeholder: "83.05 -4.87 · 05 32 11 -4 52 10 · alt 47 az 201 · Rigel" });
  where.setAttribute("aria-label", "go to: a direction or a name");
  const go = button("Go there", () => { go.disabled = true; send("goto", { text: where.value }); });
  go.disabled = true;
  const way = make("pre", { className: "rso-way", "aria-live": "polite" });
  const gotoForm = make("form", { className: "rso-goto", onsubmit: (event) => {
    event.preventDefault();
    if (!go.disabled) go.click();
  } }, make("label", {}, "Go to ", where), " ", go, way);
  const tuned = make("div", { className: "rso-tuned" });
  const effect = make("div", { className: "rso-effect", "aria-live": "polite" });
  const apply = button("Apply", applyTuned);
  const undo = button("Forget", () => { tried = {}; showTunables(); ask(); });
  const tune = make("details", { className: "rso-tune" },
    make("summary", { textContent: "Tune" }), tuned, effect, apply, " ", undo);
  const acts = make("div", { className: "rso-acts" }, arm, " ", hold);
  const controls = make("div", { className: "rso-controls" }, acts, gotoForm, tune);

  const root = make("div", { className: "rso-panel" },
    make("div", { className: "rso-head" }, words, stop), banner, alerts, dialog, said,
    make("div", { className: "rso-body" }, make("div", {}, figure, facts, health), drawn),
    controls, log);
  root.setAttribute("role", "region");
  root.setAttribute("aria-label", "rsoconsole live panel");
  // What is typed here is not for the notebook's own keys.
  root.setAttribute("data-lm-suppress-shortcuts", "true");
  root.addEventListener("keydown", (event) => event.stopPropagation());
  el.append(root);

  // -- STOP -----------------------------------------------------------------------------------
  function pressStop() {
    // One press is one STOP, however often it is said: the kernel knows it by its name.
    sayStop(`${Date.now()}-${Math.random()}`, model.get("stop_news").number || 0, 0);
  }

  function sayStop(press, before, times) {
    try {
      send("stop", { press });
    } finally {
      if (times === 0) setBanner("alarm", "STOP sent");
      const timer = setTimeout(() => {
        timers.delete(timer);
        if ((model.get("stop_news").number || 0) > before) return;
        setBanner("alarm", `STOP: NO ANSWER FROM THE KERNEL, it is busy or gone: ${CLI}`);
        if (times < STOP_TIMES) sayStop(press, before, times + 1);
      }, NO_ANSWER_MS);
      timers.add(timer);
    }
  }

  function setBanner(level, text) {
    banner.dataset.level = level;
    put(banner, text);
  }

  function showStop() {
    const news = model.get("stop_news");
    if (!news.phase) setBanner("", "");
    else setBanner(news.phase === "stopped" ? "good" : "alarm", `STOP: ${news.text}`);
  }

  // -- the engine -----------------------------------------------------------------------------
  function status() {
    return model.get("status");
  }

  function showStatus() {
    const told = status();
    seenMs = Date.now();
    if (!told.reach) {
      put(state, "asking the engine …");
      return lock();
    }
    root.dataset.reach = told.reach;
    root.dataset.state = told.state;
    if (told.reach === "attached") {
      put(state, told.is_held ? `${told.state} HELD` : told.state);
      put(holder, told.holder + (model.get("read_only") ? " (read only)" : ""));
      put(clock, `frame ${told.frame ?? "-"} · ${told.clock} UTC`);
    } else {
      put(state, told.reach === "gone" ? "ENGINE GONE" : "ENGINE SILENT");
      put(holder, `was ${told.state}`);
      put(clock, `last heard ${told.clock} UTC`);
    }
    const lines = [...told.alerts];
    if (told.detail) lines.push(told.detail);
    if (told.reach !== "attached") lines.push("STOP goes past the engine, straight to the mount");
    if (!model.get("answers_while_busy")) {
      lines.push(`this kernel hears STOP only between cells: meanwhile ${CLI}`);
    }
    rows(alerts, lines, put);
    showFacts();
    rows(health, told.health, (item, [name, ok, text]) => {
      item.className = ok ? "" : "rso-bad";
      put(item, `${ok ? "✓" : "✗"} ${name}: ${text}`);
    });
    put(arm, told.is_autonomous ? "Disarm" : "Arm");
    put(hold, told.wants_resuming ? "Resume" : "Hold");
    if (told.seat.asker) showDialog({ kind: "asker", holder: told.seat.asker });
    else if (dialog.dataset.kind === "asker") showDialog({});
    lock();
  }

  function showFacts() {
    const night = model.get("night");
    const more = night.slew ? [["slew", night.slew], ["filter", night.nis]] : [];
    rows(facts, [...(status().facts || []), ...more], (item, [name, text]) => {
      item.append(make("b", { textContent: name }), ` ${text}`);
    });
  }

  function lock() {
    const canAct = status().reach === "attached" && !model.get("read_only");
    for (const node of controls.querySelectorAll("button, input, select")) {
      if (node !== go && node !== apply) node.disabled = !canAct;
    }
    if (!canAct) go.disabled = true;
    apply.disabled = !canAct || Object.keys(tried).length === 0;
    controls.hidden = model.get("read_only");
  }

  setIntervalIn(() => {
    const isOld = Date.now() - seenMs > OLD_MS;
    root.classList.toggle("rso-old", isOld);
    if (isOld) put(clock, `the kernel has been silent for ${Math.round((Date.now() - seenMs) / 1000)} s: ` +
      `what is shown is old; if in doubt ${CLI}`);
    send("here");
  }, HERE_MS);

  function setIntervalIn(work, ms) {
    const id = setInterval(work, ms);
    timers.add(id);
  }

  // -- the record -----------------------------------------------------------------------------
  function showNight() {
    const night = model.get("night");
    if (!night.plots) return;
    for (const [name, place] of Object.entries(plots)) {
      const svg = night.plots[name] || "";
      if (place.dataset.svg !== svg) {
        place.dataset.svg = svg;
        place.innerHTML = svg;
      }
    }
    overlay.innerHTML = night.overlay;
    put(caption, night.caption);
    rows(log, [...night.log].reverse(), (item, [time, level, text]) => {
      item.className = `rso-${level}`;
      put(item, `${time} ${level === "info" ? "" : level.toUpperCase() + " "}${text}`);
    });
    showFacts();
    showTunables();
  }

  let shown = null;
  function showPicture() {
    const bytes = model.get("picture");
    if (!bytes || bytes.byteLength === 0) return;
    const address = URL.createObjectURL(new Blob([bytes], { type: "image/png" }));
    image.src = address;
    image.hidden = false;
    if (shown) URL.revokeObjectURL(shown);
    shown = address;
  }

  // -- what is asked back ---------------------------------------------------------------------
  function showDialog(asked) {
    const key = JSON.stringify(asked);
    if (dialog.dataset.key === key) return;
    dialog.dataset.key = key;
    dialog.dataset.kind = asked.kind || "";
    dialog.hidden = !asked.kind;
    dialog.replaceChildren();
    if (asked.kind === "arm") askToOverride(asked);
    else if (asked.kind === "seat") {
      dialog.append(make("p", { textContent: `${asked.holder} has control. Who is asked and says ` +
        "nothing for 30 s gives it up." }),
      button("Leave it", () => send("forget")), " ", button("Ask for it", () => order("ask_seat")));
    } else if (asked.kind === "asker") {
      dialog.append(make("p", { textContent: `${asked.holder} asks for control.` }),
        button("Keep it", () => order("answer_seat", { gives: false, to: asked.holder })), " ",
        button("Give it", () => order("answer_seat", { gives: true, to: asked.holder })));
    }
    // Asked for by a press: the answer is where the keys go. What comes by itself takes no keys.
    if (asked.kind === "arm" || asked.kind === "seat") {
      dialog.querySelector("button, input").focus({ preventScroll: true });
    }
  }

  function askToOverride(asked) {
    const ticks = asked.checks.map((check) => make("input", { type: "checkbox", value: check.name }));
    dialog.append(make("p", { textContent: asked.message }));
    asked.checks.forEach((check, n) => {
      dialog.append(make("label", {}, ticks[n], ` ${check.name}: ${check.detail}`,
        make("small", { textContent: check.remedy })));
    });
    const override = () => ticks.filter((tick) => tick.checked).map((tick) => tick.value);
    dialog.append(button("Stay disarmed", () => send("forget")), " ",
      button("Arm, overriding the ticked", () => order("arm", { override: override() }), "rso-careful"));
  }

  // -- go to ----------------------------------------------------------------------------------
  let typing = 0;
  let number = 0;
  where.addEventListener("input", () => {
    go.disabled = true;
    put(way, "");
    clearTimeout(typing);
    if (!where.value.trim()) return;
    typing = setTimeout(() => send("goto_preview", { text: where.value, number: ++number }), TYPED_MS);
  });

  function showGoto() {
    const told = model.get("goto");
    if (told.number !== undefined && told.number !== number) return;
    put(way, (told.lines || []).join("\n"));
    go.disabled = !told.may_go;
  }

  // -- tune -----------------------------------------------------------------------------------
  let tried = {};
  let tuning = 0;
  let askedEffect = 0;
  function showTunables() {
    const list = model.get("night").tunables || [];
    const key = JSON.stringify(list.map((each) => each[0]));
    if (tuned.dataset.key !== key) {
      tuned.dataset.key = key;
      tuned.replaceChildren(...list.map(tunable));
    }
    for (const [name, , , value] of list) {
      if (String(tried[name]) === String(value)) delete tried[name];
      const field = tuned.querySelector(`[name="${name}"]`);
      field.classList.toggle("rso-tried", name in tried);
      if (field !== document.activeElement) field.value = name in tried ? tried[name] : value;
    }
    lock();
  }

  function tunable([name, label, unit, , choices]) {
    const field = choices.length
      ? make("select", {}, ...choices.map((each) => make("option", { textContent: each })))
      : make("input", { type: "number", step: "any" });
    field.name = name;
    field.addEventListener("input", () => {
      const value = choices.length ? field.value : field.valueAsNumber;
      if (Number.isNaN(value)) delete tried[name];
      else tried[name] = value;
      clearTimeout(tuning);
      tuning = setTimeout(ask, TYPED_MS);
      showTunables();
    });
    return make("label", {}, `${label} `, field, unit ? ` ${unit}` : "");
  }

  function ask() {
    send("try", { settings: tried, number: ++askedEffect });
  }
  tune.addEventListener("toggle", () => { if (tune.open) ask(); });

  function showEffect() {
    const told = model.get("effect");
    if (told.number !== undefined && told.number !== askedEffect) return;
    if (told.fault || !told.rows) return effect.replaceChildren(told.fault || "");
    const cell = (tag, text) => make(tag, { textContent: text });
    effect.replaceChildren(make("table", {},
      make("tr", {}, ...[`last ${told.frames} frames`, "as it was", "if tried"].map((each) => cell("th", each))),
      ...told.rows.map((row) => make("tr", {}, ...row.map((each) => cell("td", each))))));
  }

  function applyTuned() {
    for (const [name, value] of Object.entries(tried)) order("set", { name, value });
  }

  // -- as it changes --------------------------------------------------------------------------
  const showSaid = () => {
    const told = model.get("said");
    said.dataset.level = told.level || "";
    put(said, told.text || "");
  };
  const showAsked = () => showDialog(model.get("asked"));
  const heard = { status: showStatus, night: showNight, picture: showPicture, said: showSaid,
    asked: showAsked, stop_news: showStop, goto: showGoto, effect: showEffect };
  for (const [name, show] of Object.entries(heard)) {
    model.on(`change:${name}`, show);
    show();
  }
  send("here");

  return () => {
    for (const timer of timers) { clearInterval(timer); clearTimeout(timer); }
    clearTimeout(typing);
    clearTimeout(tuning);
    for (const [name, show] of Object.entries(heard)) model.off(`change:${name}`, show);
    if (shown) URL.revokeObjectURL(shown);
  };
}

export default { render };
