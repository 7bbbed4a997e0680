// Draws the scene with meshcat's viewer and answers the overlay. No request leaves this page.
(() => {
  "use strict";
  const THREE = MeshCat.THREE;
  const { addEdges, fade, makeGlass, meshes, pushBack, setUpCopies } = Look;
  const scene = JSON.parse(document.getElementById("scene-data").textContent);
  const element = (id) => document.getElementById(id);
  const pane = element("meshcat-pane");

  let viewer;
  try {
    viewer = new MeshCat.Viewer(pane);
  } catch (error) {
    element("trouble").hidden = false;
    element("trouble").textContent = "This browser cannot draw in 3D (WebGL is missing or switched off).";
    return;
  }
  const decode = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  for (const command of scene.commands) viewer.handle_command_bytearray(decode(command));
  delete scene.commands;

  const node = (...path) => viewer.scene_tree.find(["lis_grasp", ...path]).object;
  // ---- set-up ----------------------------------------------------------------------------
  const outline = scene.camera.object.concat(scene.camera.hand);
  const box = new THREE.Box3().setFromPoints(outline.map((p) => new THREE.Vector3(...p)));
  const middle = box.getCenter(new THREE.Vector3());
  const reach = box.getSize(new THREE.Vector3()).length() / 2;

  function setUpRenderer() {
    const renderer = viewer.renderer;
    renderer.outputEncoding = THREE.sRGBEncoding;
    renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    for (const name of ["Lights", "Grid", "Axes"]) viewer.delete_path([name]);
    viewer.hide_background(); // the page's own background shows through
    viewer.gui.domElement.style.display = "none";
    viewer.scene.traverse((o) => {
      if (o.material && o.material.color) o.material.color.convertSRGBToLinear();
    });
    viewer.scene.environment = Look.studio(renderer);
  }

  // ---- layers ----------------------------------------------------------------------------
  const wanted = new Map(scene.layers.map((layer) => [layer.id, layer.on]));
  const colours = new Map(scene.layers.map((layer) => [layer.id, layer.colour]));
  const has = (id) => wanted.has(id);

  const layers = {};
  let grasps = [];
  function gatherLayers() {
    for (const id of ["estimate", "contacts", "free"]) if (has(id)) layers[id] = node("object", id);
    if (layers.contacts) setUpCopies(layers.contacts);
    if (layers.free) setUpCopies(layers.free);
    if (has("truth")) {
      layers.truth = node("object", "truth");
      layers.glass = makeGlass(layers.truth);
      for (const mesh of meshes(layers.truth)) pushBack(mesh.material);
      node("object").add(layers.glass);
    }
    const table = [...meshes(node("table")), ...meshes(node("grid"))];
    for (const mesh of table) mesh.castShadow = false;
    for (const mesh of meshes(node("table"))) pushBack(mesh.material);
    const hand = node("hand");
    for (const mesh of meshes(hand)) {
      pushBack(mesh.material);
      addEdges(mesh, mesh.material.color.clone().lerp(new THREE.Color(1, 1, 1), 0.22), 0.6);
    }
    grasps = scene.grasps.map((poses, rank) => {
      const group = new THREE.Group();
      poses.forEach((matrix, link) => {
        const part = node("hand", String(link)).clone(true);
        part.matrixAutoUpdate = false;
        part.matrix.fromArray(matrix);
        group.add(part);
      });
      const tint = new THREE.Color(colours.get(`grasp-${rank + 1}`)).convertSRGBToLinear();
      for (const mesh of meshes(group)) {
        mesh.material = mesh.material.clone();
        if (rank > 0) mesh.material.color.lerp(tint, 0.75); // several hands at once stay apart
      }
      node("object").add(group);
      return group;
    });
    layers.hand = hand;
  }

  // ---- time ------------------------------------------------------------------------------
  let time = 0;
  let playing = false;
  let toggle = () => {}; // plays and pauses, where there is something to play
  const ramp = (from, to, x) => { const s = Math.min(1, Math.max(0, (x - from) / (to - from))); return s * s * (3 - 2 * s); };

  // What is seen is a function of the time and the ticked layers alone: at rest what was felt and
  // believed, and during the lift what really happened.
  function show() {
    const lifting = scene.duration > 0 && wanted.get("lift");
    if (!lifting) time = 0;
    const fact = lifting ? ramp(0, Math.min(0.5, 0.2 * scene.duration), time) : 0;
    const on = (id) => (wanted.get(id) ? 1 : 0);
    const truthTakesOver = has("truth") && wanted.get("truth");
    const belief = truthTakesOver ? 1 - fact : 1; // without the truth the estimate rides along
    if (layers.estimate) fade(layers.estimate, on("estimate") * belief);
    if (layers.contacts) fade(layers.contacts, on("contacts") * belief);
    if (layers.free) fade(layers.free, on("free") * (1 - fact));
    if (layers.truth) {
      const alone = !(layers.estimate && wanted.get("estimate"));
      // Solid at once, behind the fading estimate: two clear surfaces in one place would flicker.
      const solid = alone || fact > 0;
      fade(layers.truth, on("truth") * (solid ? 1 : 0));
      fade(layers.glass, on("truth") * (solid ? 0 : 1));
    }
    const moving = lifting && time > 0; // one hand makes way for the other at once
    grasps.forEach((group, rank) => fade(group, moving ? 0 : on(`grasp-${rank + 1}`)));
    fade(layers.hand, moving ? 1 : 0);
    if (scene.duration > 0) {
      viewer.animator.seek(time);
      updatePlayer(lifting);
      if (!touched) placeCamera();
    }
    viewer.set_dirty();
  }

  function updatePlayer(lifting) {
    element("player").hidden = !lifting;
    element("player").style.display = lifting ? "" : "none";
    element("time").value = String(time);
    element("clock").textContent = `${time.toFixed(2)} / ${scene.duration.toFixed(2)} s`;
    const ended = !playing && time >= scene.duration;
    element("play").className = playing ? "playing" : ended ? "ended" : "";
    element("play").setAttribute("aria-label", playing ? "Pause" : ended ? "Play the lift again" : "Play the lift");
  }

  function setUpPlayer() {
    if (!(scene.duration > 0)) return;
    for (const action of viewer.animator.actions) action.play(); // so that seeking takes effect
    let last = null;
    const step = (now) => {
      if (!playing) return;
      // A page that was hidden for a while goes on where it was.
      if (last !== null) time = Math.min(scene.duration, time + Math.min(0.25, (now - last) / 1000));
      last = now;
      if (time >= scene.duration) playing = false;
      show();
      requestAnimationFrame(step);
    };
    toggle = () => {
      playing = !playing;
      if (playing && time >= scene.duration) time = 0;
      last = null;
      if (playing) requestAnimationFrame(step);
      show();
    };
    element("play").addEventListener("click", toggle);
    element("time").addEventListener("input", (event) => {
      playing = false;
      time = Number(event.target.value);
      show();
    });
    window.addEventListener("keydown", (event) => {
      if (event.code !== "Space" || event.target.closest("button, input, summary")) return;
      event.preventDefault();
      if (wanted.get("lift")) toggle();
    });
  }

  // ---- camera ----------------------------------------------------------------------------
  let view = { azimuth: scene.camera.azimuth, elevation: scene.camera.elevation, zoom: 1 };
  let touched = false; // whether a hand has moved the camera
  let frames = null;

  // What of the window the overlay leaves free, in pixels.
  function freeArea() {
    const whole = { left: 0, top: 0, right: window.innerWidth, bottom: window.innerHeight };
    if (document.body.classList.contains("bare")) return whole;
    const panel = element("panel").getBoundingClientRect();
    if (whole.right > 640 && element("panel").open) whole.left = panel.right;
    else whole.top = Math.min(panel.bottom, 70);
    const player = element("player");
    if (player && player.offsetHeight) whole.bottom = player.getBoundingClientRect().top;
    return whole;
  }

  // The nearest camera that looks from the chosen side and has every point inside the free area.
  function fit(points, axes, free) {
    const [right, up, back] = axes;
    const tangent = 0.9 * Math.tan(THREE.MathUtils.degToRad(viewer.camera.fov / 2)); // 0.9: a margin
    const tall = (tangent * (free.bottom - free.top)) / window.innerHeight;
    const wide = (tangent * (free.right - free.left)) / window.innerHeight;
    const target = middle.clone();
    let distance = 0;
    for (let round = 0; round < 20; round++) {
      distance = 0;
      const seen = points.map((p) => {
        const r = new THREE.Vector3(...p).sub(target);
        const q = { x: r.dot(right), y: r.dot(up), z: r.dot(back) };
        distance = Math.max(distance, q.z + Math.abs(q.x) / wide, q.z + Math.abs(q.y) / tall);
        return q;
      });
      let [x0, x1, y0, y1] = [Infinity, -Infinity, Infinity, -Infinity];
      for (const q of seen) { // where it is seen on the plane through the target
        const scale = distance / (distance - q.z);
        x0 = Math.min(x0, q.x * scale); x1 = Math.max(x1, q.x * scale);
        y0 = Math.min(y0, q.y * scale); y1 = Math.max(y1, q.y * scale);
      }
      target.addScaledVector(right, (x0 + x1) / 2).addScaledVector(up, (y0 + y1) / 2);
    }
    return { target, distance };
  }

  // The arrows stand out of the object's outline by about so much.
  const centre = new THREE.Box3().setFromPoints(scene.camera.object.map((p) => new THREE.Vector3(...p))).getCenter(new THREE.Vector3());
  const withArrows = (p) => new THREE.Vector3(...p).sub(centre).multiplyScalar(1.25).add(centre).toArray();

  // Finds the views of the rest and of the lift for the window and the chosen direction.
  function frame() {
    const free = freeArea();
    const [width, height] = [window.innerWidth, window.innerHeight];
    const a = THREE.MathUtils.degToRad(view.azimuth);
    const e = THREE.MathUtils.degToRad(view.elevation);
    const back = new THREE.Vector3(Math.cos(e) * Math.cos(a), Math.cos(e) * Math.sin(a), Math.sin(e));
    const right = new THREE.Vector3(-Math.sin(a), Math.cos(a), 0);
    const axes = [right, new THREE.Vector3().crossVectors(back, right), back];
    Object.assign(viewer.camera, { fov: 28, near: 0.02 * reach, far: 60 * reach });
    const gripped = [...wanted].some(([id, on]) => on && id.startsWith("grasp-"));
    const rest = fit(gripped ? outline : scene.camera.object.map(withArrows), axes, free);
    const moved = scene.camera.moved;
    const lift = moved.length ? fit(outline.concat(moved), axes, free) : rest;
    frames = { back, rest, lift };
    aimLights(view.azimuth);
    const [dx, dy] = [(free.left + free.right - width) / 2, (free.top + free.bottom - height) / 2];
    viewer.camera.setViewOffset(width, height, -dx, -dy, width, height);
    Object.assign(viewer.controls, { minDistance: 0.3 * reach, maxDistance: 20 * reach });
    placeCamera();
    viewer.set_3d_pane_size();
  }

  // Between the two views, by the time of the lift; a camera moved by hand is left alone.
  function placeCamera() {
    if (!frames) return;
    const share = time > 0 ? ramp(0, Math.min(0.4, 0.2 * scene.duration), time) : 0;
    const target = frames.rest.target.clone().lerp(frames.lift.target, share);
    const distance = THREE.MathUtils.lerp(frames.rest.distance, frames.lift.distance, share) / view.zoom;
    const toViewer = (v) => new THREE.Vector3(v.x, v.z, -v.y); // z up to y up
    viewer.controls.target.copy(toViewer(target));
    viewer.camera.position.copy(toViewer(target.addScaledVector(frames.back, distance)));
    viewer.controls.update();
  }

  // ---- the page's address ----------------------------------------------------------------
  function readAddress() {
    const asked = new URLSearchParams(location.hash.slice(1));
    const number = (key, otherwise) => {
      const value = Number.parseFloat(asked.get(key));
      return Number.isFinite(value) ? value : otherwise;
    };
    if (asked.has("layers")) {
      const chosen = new Set(asked.get("layers").split(","));
      for (const id of wanted.keys()) wanted.set(id, chosen.has(id) || (id === "lift" && asked.has("t")));
    }
    if (asked.has("t")) time = Math.min(scene.duration, Math.max(0, number("t", 0)));
    view = {
      azimuth: number("azimuth", view.azimuth),
      elevation: number("elevation", view.elevation),
      zoom: Math.max(0.05, number("zoom", view.zoom)),
    };
    document.body.classList.toggle("bare", asked.get("panel") === "0");
    if (asked.has("panel")) element("panel").open = asked.get("panel") !== "0";
    playing = false;
    for (const input of document.querySelectorAll("[data-layer]")) input.checked = wanted.get(input.dataset.layer);
  }

  setUpRenderer();
  const aimLights = Look.addLights(viewer.scene, middle, reach);
  gatherLayers();
  if (window.innerWidth <= 640 || window.innerHeight <= 480) element("panel").open = false;
  setUpPlayer();
  const start = () => {
    readAddress();
    show();
    frame();
    if (new URLSearchParams(location.hash.slice(1)).get("play") === "1" && wanted.get("lift")) toggle();
  };
  start();
  viewer.controls.addEventListener("start", () => { touched = true; });
  window.onload = null;
  window.addEventListener("resize", () => { if (touched) viewer.set_3d_pane_size(); else frame(); });
  window.addEventListener("hashchange", start);
  element("panel").addEventListener("toggle", () => { if (!touched) frame(); });
  for (const input of document.querySelectorAll("[data-layer]")) {
    input.addEventListener("change", () => {
      wanted.set(input.dataset.layer, input.checked);
      if (input.dataset.layer === "lift") playing = false;
      show();
    });
  }
  document.body.dataset.ready = "true";
})();
