// Clouds of points side by side, turned together. Drawn on plain canvases with a depth buffer, so that the
// page needs no library and no graphics card.
function showScenes(root, scenes) {
  const panes = root.querySelector(".panes"), chooser = root.querySelector("select");
  const modes = root.querySelector(".modes"), legend = root.querySelector(".legend");
  let view, scene, clouds, mode = "seen", waiting = false;
  const bytes = text => Uint8Array.from(atob(text), letter => letter.charCodeAt(0));
  const home = () => ({ yaw: scene.fromCamera ? 0.45 : 0.6, pitch: scene.fromCamera ? 0.3 : 0.4, zoom: 1, x: 0, y: 0 });

  function open(index) {
    scene = scenes[index];
    view = home();
    panes.textContent = "";
    clouds = scene.clouds.map(cloud => {
      const figure = document.createElement("figure"), canvas = document.createElement("canvas");
      const caption = document.createElement("figcaption");
      caption.textContent = cloud.name;
      figure.append(caption, canvas);
      panes.append(figure);
      const colours = { seen: bytes(cloud.seen) };
      if (cloud.error) colours.error = bytes(cloud.error);
      listen(canvas);
      return { canvas, colours, points: new Int16Array(bytes(cloud.points).buffer) };
    });
    modes.hidden = !scene.clouds.some(cloud => cloud.error);
    draw();
  }

  function draw() {
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => { waiting = false; clouds.forEach(paint); });
    legend.hidden = mode !== "error" || modes.hidden;
    legend.lastElementChild.textContent = `${scene.largestError?.toFixed(1)} mm and more`;
  }

  function paint({ canvas, colours, points }) {
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const width = canvas.width = Math.round(canvas.clientWidth * ratio);
    const height = canvas.height = Math.round(canvas.clientHeight * ratio);
    const context = canvas.getContext("2d"), picture = context.createImageData(width, height);
    const pixels = new Uint32Array(picture.data.buffer).fill(0xff1a1614);
    const nearest = new Float32Array(width * height).fill(Infinity);
    const rgb = colours[mode] || colours.seen, away = 2.4 * scene.reach;
    const focal = 1.1 * Math.min(width, height) * view.zoom, count = points.length / 3;
    const size = Math.max(2, Math.round(1.5 * view.zoom * Math.sqrt(width * height / count) * 0.6));
    const [cy, sy, cp, sp] = [Math.cos(view.yaw), Math.sin(view.yaw), Math.cos(view.pitch), Math.sin(view.pitch)];
    for (let i = 0; i < count; i++) {
      const x = points[3 * i] / scene.steps, y = points[3 * i + 1] / scene.steps, z = points[3 * i + 2] / scene.steps;
      const turned = cy * x - sy * z, deep = sy * x + cy * z;
      const down = cp * y - sp * deep, depth = sp * y + cp * deep + away;
      if (depth < 0.05 * scene.reach) continue;
      const left = Math.round(width / 2 + view.x * ratio + focal * turned / depth - size / 2);
      const top = Math.round(height / 2 + view.y * ratio + focal * down / depth - size / 2);
      const colour = 0xff000000 | rgb[3 * i + 2] << 16 | rgb[3 * i + 1] << 8 | rgb[3 * i];
      for (let v = Math.max(top, 0); v < Math.min(top + size, height); v++)
        for (let u = Math.max(left, 0); u < Math.min(left + size, width); u++) {
          const place = v * width + u;
          if (depth < nearest[place]) { nearest[place] = depth; pixels[place] = colour; }
        }
    }
    context.putImageData(picture, 0, 0);
  }

  function listen(canvas) {
    canvas.addEventListener("pointerdown", event => canvas.setPointerCapture(event.pointerId));
    canvas.addEventListener("pointermove", event => {
      if (!event.buttons) return;
      if (event.shiftKey || event.buttons === 2) { view.x += event.movementX; view.y += event.movementY; }
      else { view.yaw += event.movementX * 0.008; view.pitch -= event.movementY * 0.008; }
      draw();
    });
    canvas.addEventListener("wheel", event => {
      event.preventDefault();
      view.zoom = Math.min(20, Math.max(0.2, view.zoom * Math.exp(-event.deltaY * 0.0012)));
      draw();
    }, { passive: false });
    canvas.addEventListener("dblclick", () => { view = home(); draw(); });
    canvas.addEventListener("contextmenu", event => event.preventDefault());
  }

  scenes.forEach((one, index) => chooser.add(new Option(one.title, index)));
  chooser.hidden = scenes.length < 2;
  chooser.addEventListener("change", () => open(Number(chooser.value)));
  modes.addEventListener("change", event => { mode = event.target.value; draw(); });
  window.addEventListener("resize", draw);
  open(0);
}
