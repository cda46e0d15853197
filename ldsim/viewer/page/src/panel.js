// The controls and the numbers beside the picture.

const $ = (id) => document.getElementById(id);
const round = (x, digits) => (Number.isFinite(x) ? x.toFixed(digits) : '–');
const NAMES = { latent: 'Latent', linear: 'Linear', full: 'Full' };
const OUTCOMES = ['', 'stopped early', 'slowed', 'held'];

export class Panel {
  /** send: to the server; local: what the page itself does (theme, points, wireframe). */
  constructor(solid, send, local) {
    this.solid = solid;
    this.send = send;
    this.tilt = [0, 0];
    document.title = `${solid.title} · ldsim`;
    $('title').textContent = solid.title;
    $('subtitle').textContent = solid.subtitle;
    $('pause').onclick = () => send('pause', { value: !this.status.paused });
    $('step').onclick = () => send('step');
    $('reset').onclick = () => send('reset');
    $('speed').onchange = () => send('speed', { value: Number($('speed').value) });
    $('stiffness').oninput = () => send('stiffness', { value: 10 ** Number($('stiffness').value) });
    $('gravity').onchange = () => this.sendGravity();
    $('colour').onchange = () => {
      local.colour($('colour').value);
      send('colour', { value: $('colour').value });
    };
    $('points').onchange = () => local.points($('points').checked);
    $('wireframe').onchange = () => local.wireframe($('wireframe').checked);
    $('theme').onclick = () => local.theme(document.documentElement.dataset.theme === 'dark' ? 'light' : 'dark');
    $('fold').onclick = () => document.body.classList.toggle('folded');
    $('record').onclick = () => send('record', { value: !this.status.recorder.recording });
    $('replay').onclick = () => send('replay', { value: !this.status.recorder.replaying });
    this.makeTilt();
    addEventListener('keydown', (event) => this.key(event));
  }

  key(event) {
    if (event.target.matches('input[type=range], select') || event.ctrlKey || event.metaKey) return;
    const press = { ' ': 'pause', '.': 'step', r: 'reset' }[event.key];
    if (!press) return;
    event.preventDefault();
    $(press).click();
  }

  /** A pad on which the direction of gravity is dragged; a double click sets it upright. */
  makeTilt() {
    const pad = $('tilt');
    const set = (event) => {
      const box = pad.getBoundingClientRect();
      const [x, y] = [(2 * (event.clientX - box.left)) / box.width - 1, (2 * (event.clientY - box.top)) / box.height - 1];
      const length = Math.max(1, Math.hypot(x, y));
      this.setTilt(x / length, y / length);
    };
    pad.onpointerdown = (event) => {
      pad.setPointerCapture(event.pointerId);
      set(event);
    };
    pad.onpointermove = (event) => event.buttons && set(event);
    pad.ondblclick = () => this.setTilt(0, 0);
    pad.onkeydown = (event) => {
      const step = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[event.key];
      if (step) this.setTilt(this.tilt[0] + step[0], this.tilt[1] + step[1]);
    };
  }

  setTilt(x, y) {
    const length = Math.max(1, Math.hypot(x, y));
    this.tilt = [x / length, y / length];
    this.showTilt();
    $('gravity').checked = true;
    this.sendGravity();
  }

  showTilt() {
    $('needle').style.transform = `translate(${50 * this.tilt[0]}%, ${50 * this.tilt[1]}%)`;
  }

  sendGravity() {
    const { up, right, toward, strength } = this.solid.frame;
    const [x, y] = this.tilt;
    const down = Math.cos((Math.hypot(x, y) * Math.PI) / 2);
    const aside = Math.hypot(x, y) > 0 ? Math.sin((Math.hypot(x, y) * Math.PI) / 2) / Math.hypot(x, y) : 0;
    const size = $('gravity').checked ? strength : 0;
    const value = [0, 1, 2].map((i) => size * (-down * up[i] + aside * (x * right[i] + y * toward[i])));
    this.send('gravity', { value });
  }

  show(status) {
    this.status = status;
    $('pause').textContent = status.paused ? '▶' : '❚❚';
    $('pause').title = status.paused ? 'Go on (space)' : 'Pause (space)';
    $('speed').value = String(status.speed);
    $('stiffness').value = String(Math.log10(status.stiffness));
    $('stiffnessValue').textContent = `× ${status.stiffness < 1 ? round(status.stiffness, 2) : round(status.stiffness, 1)}`;
    $('gravity').checked = status.gravity.some((x) => x !== 0);
    $('colour').value = status.colour;
    this.showSpaces(status);
    $('recorder').hidden = status.recorder === null;
    document.body.classList.toggle('recording', Boolean(status.recorder?.recording));
    if (!status.recorder) return;
    const { recording, replaying, frames, file } = status.recorder;
    $('record').textContent = recording ? '■ Stop' : '● Record';
    $('replay').textContent = replaying ? '■ Stop' : '▶ Play back';
    $('replay').disabled = recording || frames === 0;
    $('file').textContent = frames ? `${file} · ${frames} frames` : file;
  }

  showSpaces({ offered, spaces }) {
    $('spaces').hidden = offered.length < 2;
    $('spaces').replaceChildren(
      ...offered.map((name) => {
        const button = document.createElement('button');
        button.textContent = NAMES[name];
        button.className = `space ${name}`;
        button.setAttribute('aria-pressed', String(spaces.includes(name)));
        button.onclick = () => {
          const next = offered.filter((other) => (other === name) !== this.status.spaces.includes(other));
          if (!next.length) return;
          this.status.spaces = next; // the next click may come before the server's word
          this.send('spaces', { value: next });
        };
        return button;
      }),
    );
  }

  /** Numbers of a frame; twice a second. */
  statistics(frame, spaces, framesPerSecond) {
    $('fps').textContent = `${round(framesPerSecond, 0)} frames/s · ${round(frame.seconds, 1)} s simulated · ${frame.bytes} B a frame`;
    $('statistics').replaceChildren(
      ...frame.spaces.map((space, i) => {
        const row = document.createElement('tr');
        const cells = [
          NAMES[spaces[i]],
          frame.paused && !space.milliseconds ? '–' : `${space.milliseconds < 1 ? round(space.milliseconds, 3) : round(space.milliseconds, 1)} ms`,
          round(space.iterations, 1),
          round(space.evaluations, 1),
          OUTCOMES[space.outcome] || (space.distrust > 1 ? 'untrained' : space.troubled ? `${space.troubled} uneasy` : 'fine'),
        ];
        cells.forEach((text, n) => {
          const cell = document.createElement(n ? 'td' : 'th');
          cell.textContent = text;
          row.append(cell);
        });
        row.className = `${spaces[i]} ${space.outcome > 1 || space.distrust > 1 ? 'uneasy' : ''}`;
        return row;
      }),
    );
  }

  legend(text) {
    $('legend').hidden = text === null;
    if (text !== null) [$('low').textContent, $('high').textContent] = text;
  }

  notice(text, sticky = false) {
    clearTimeout(this.clearing);
    $('notice').textContent = text;
    $('notice').hidden = text === '';
    if (!sticky) this.clearing = setTimeout(() => ($('notice').hidden = true), 6000);
  }
}
