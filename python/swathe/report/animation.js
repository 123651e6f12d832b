"use strict";
(() => {
  const film = JSON.parse(document.getElementById("film").textContent);
  const canvas = document.getElementById("ground");
  const pen = canvas.getContext("2d");
  const base = document.getElementById("base");
  const play = document.getElementById("play");
  const at = document.getElementById("at");
  const show = document.getElementById("show");
  const words = document.getElementById("words");
  const frames = film.frames.map((frame) => {
    const picture = new Image();
    picture.src = frame.picture;
    const bytes = Uint8Array.from(atob(frame.agents), (sign) => sign.charCodeAt(0));
    return { picture, agents: new DataView(bytes.buffer), words: frame.words };
  });
  const numbers = (packed) => {
    const bytes = Uint8Array.from(atob(packed), (sign) => sign.charCodeAt(0));
    const view = new DataView(bytes.buffer);
    return Array.from({ length: bytes.length / 2 }, (_, i) => view.getUint16(2 * i, true) / 16);
  };
  const arcs = (film.arcs || []).map(numbers);
  const ends = (film.ends || []).map(numbers);
  let timer = null;

  function line(points, zoom, colour, opacity, width) {
    pen.globalAlpha = opacity;
    pen.strokeStyle = colour;
    pen.lineWidth = width;
    pen.lineJoin = pen.lineCap = "round";
    pen.beginPath();
    for (let i = 0; i < points.length; i += 2) pen.lineTo(points[i] * zoom, points[i + 1] * zoom);
    pen.stroke();
    pen.globalAlpha = 1;
  }

  function drawArcs(number, zoom) {
    const route = film.routes[number];
    const now = film.shown[number];
    // Earlier arcs fade, the latest last; a route has none behind it.
    for (let back = film.fading.length; !route && back > 0; back -= 1) {
      if (now - back >= 0) line(arcs[now - back], zoom, film.laid, film.fading[back - 1], 2);
    }
    line(arcs[now], zoom, "#fff", 0.9, 5);
    line(arcs[now], zoom, route ? film.route : film.laid, 1, 3);
    ends.forEach(([x, y], i) => {
      pen.beginPath();
      pen.arc(x * zoom, y * zoom, 5.5, 0, 7);
      pen.fillStyle = "#fff";
      pen.fill();
      pen.strokeStyle = pen.fillStyle = "#23262b";
      pen.lineWidth = 2;
      pen.stroke();
      if (i === 1) {
        pen.beginPath();
        pen.arc(x * zoom, y * zoom, 3, 0, 7);
        pen.fill();
      }
    });
  }

  function draw() {
    const frame = frames[Number(at.value)];
    const zoom = canvas.width / film.columns;
    pen.drawImage(base, 0, 0, canvas.width, canvas.height);
    pen.imageSmoothingEnabled = false;
    pen.drawImage(frame.picture, 0, 0, canvas.width, canvas.height);
    if (show.checked) {
      pen.fillStyle = "#23262b";
      for (let i = 0; i < frame.agents.byteLength; i += 4) {
        pen.beginPath();
        const x = (frame.agents.getUint16(i + 2, true) + 0.5) * zoom;
        const y = (frame.agents.getUint16(i, true) + 0.5) * zoom;
        pen.arc(x, y, 1.4, 0, 7);
        pen.fill();
      }
    }
    if (arcs.length) drawArcs(Number(at.value), zoom);
    words.textContent = frame.words;
  }

  function pause() {
    clearInterval(timer);
    timer = null;
    play.textContent = "Play";
    play.setAttribute("aria-pressed", "false");
  }

  function start() {
    if (Number(at.value) === frames.length - 1) at.value = "0";
    play.textContent = "Pause";
    play.setAttribute("aria-pressed", "true");
    timer = setInterval(() => {
      at.value = String(Number(at.value) + 1);
      draw();
      if (Number(at.value) === frames.length - 1) pause();
    }, 110);
  }

  const toggle = () => (timer === null ? start() : pause());
  play.addEventListener("click", toggle);
  at.addEventListener("input", () => { pause(); draw(); });
  show.addEventListener("change", draw);
  document.addEventListener("keydown", (event) => {
    if (event.code === "Space" && event.target !== play && event.target !== show) {
      event.preventDefault();
      toggle();
    }
  });
  const first = /^#(\d+)$/.exec(location.hash);
  const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
  at.value = String(first === null ? frames.length - 1 : Number(first[1]));
  for (const picture of [base, ...frames.map((frame) => frame.picture)]) {
    // A picture that comes late is drawn when it comes, if it is the one to show.
    if (!picture.complete) picture.addEventListener("load", draw);
  }
  draw();
  if (first === null && !still) {
    at.value = "0";
    start();
  }
})();
