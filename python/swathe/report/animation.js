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
  let timer = null;

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
