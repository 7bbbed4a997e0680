// Draws the scene with meshcat's viewer and handles the overlay. The page sends no request.
(async () => {
  "use strict";
  const THREE = MeshCat.THREE;
  const { addEdges, fade, hideInside, makeClear, makeGlass, meshes, pushBack, reveal, setUpCopies } = Appearance;
  const scene = JSON.parse(document.getElementById("scene-data").textContent);
  const element = (id) => document.getElementById(id);
  const pane = element("meshcat-pane");
  const tell = (trouble) => {
    element("trouble").hidden = false;
    element("trouble").textContent = trouble;
  };
  window.addEventListener("unhandledrejection", ({ reason }) => tell(`This page cannot be drawn: ${reason}`));
  window.addEventListener("error", ({ message }) => tell(`This page cannot be drawn: ${message}`));

  let viewer;
  try {
    viewer = new MeshCat.Viewer(pane);
  } catch (error) {
    tell("This browser cannot draw in 3D (WebGL is missing or switched off).");
    return;
  }
  if (!window.DecompressionStream) {
    tell("This page needs a browser of 2023 or later.");
    return;
  }
  window.onload = null;
  const packed = Uint8Array.from(atob(scene.commands), (c) => c.charCodeAt(0));
  const unpacked = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const commands = new Uint8Array(await new Response(unpacked).arrayBuffer());
  let read = 0;
  for (const length of scene.lengths) {
    viewer.handle_command_bytearray(commands.slice(read, read + length));
    read += length;
  }
  delete scene.commands;

  const node = (...path) => viewer.scene_tree.find(["lis_grasp", ...path]).object;
  const story = Story(scene.story);

  function setUpRenderer() {
    const renderer = viewer.renderer;
    renderer.outputEncoding = THREE.sRGBEncoding;
    renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    for (const name of ["Lights", "Grid", "Axes"]) viewer.delete_path([name]);
    viewer.hide_background(); // shows the page's own background
    viewer.gui.domElement.style.display = "none";
    viewer.scene.traverse((o) => {
      if (o.material && o.material.color) o.material.color.convertSRGBToLinear();
    });
    viewer.scene.environment = Appearance.studio(renderer);
  }

  // ---- layers ----------------------------------------------------------------------------
  const facts = new Map(scene.layers.map((layer) => [layer.id, layer]));
  const wanted = new Map(); // which layers are ticked
  const has = (id) => facts.has(id);

  const BESIDE = ["surroundings", "free-bodies"]; // bodies beside the object
  const VIEW = ["seen", "guessed", "unknown"]; // of a camera, before the first touch
  const layers = {};
  let surfaces = []; // { count, group }: the estimate from `count` contacts
  let grasps = [];
  let toucher = null;
  function gatherLayers() {
    for (const id of ["contacts", "normals", "free", ...VIEW]) {
      if (!has(id)) continue;
      layers[id] = node("object", id);
      setUpCopies(layers[id]);
    }
    if (has("estimate")) {
      const counted = Object.keys(viewer.scene_tree.find(["lis_grasp", "object", "estimate"]).children);
      surfaces = counted.filter((name) => /^\d+$/.test(name)).map(Number).sort((a, b) => a - b)
        .map((count) => ({ count, group: node("object", "estimate", String(count)) }));
    }
    if (has("truth")) {
      layers.truth = node("object", "truth");
      layers.glass = makeGlass(layers.truth);
      for (const mesh of meshes(layers.truth)) pushBack(mesh.material);
      node("object").add(layers.glass);
    }
    for (const id of ["search", "motion"]) {
      if (!has(id)) continue;
      layers[id] = node(id);
      for (const mesh of meshes(layers[id])) mesh.castShadow = false;
    }
    for (const id of BESIDE) {
      if (has(id)) makeClear(layers[id] = node(id));
    }
    const table = [...meshes(node("table")), ...meshes(node("grid"))];
    for (const mesh of table) mesh.castShadow = false;
    for (const mesh of meshes(node("table"))) pushBack(mesh.material);
    const hand = node("hand");
    for (const mesh of meshes(hand)) {
      pushBack(mesh.material);
      addEdges(mesh, mesh.material.color.clone().lerp(new THREE.Color(1, 1, 1), 0.22), 0.6);
    }
    // A copy of the hand for each grasp, and one for all touches.
    const posed = (poses) => {
      const group = new THREE.Group();
      poses.forEach((matrix, link) => {
        const part = node("hand", String(link)).clone(true);
        part.matrixAutoUpdate = false;
        part.matrix.fromArray(matrix);
        group.add(part);
      });
      for (const mesh of meshes(group)) mesh.material = mesh.material.clone();
      node("object").add(group);
      return group;
    };
    grasps = scene.grasps.map((poses, rank) => {
      const group = posed(poses);
      const tint = new THREE.Color(facts.get(`grasp-${rank + 1}`).colour).convertSRGBToLinear();
      if (rank > 0 && !scene.story.postures) for (const mesh of meshes(group)) mesh.material.color.lerp(tint, 0.75); // distinguishes several hands
      return group;
    });
    const touch = scene.touches.find((one) => one);
    if (touch) {
      toucher = posed(touch.links.concat(touch.arm ? touch.arm[0] : []));
      hideInside(toucher);
    }
    layers.hand = hand;
  }

  // ---- time ------------------------------------------------------------------------------
  const APPROACH = 0.3; // distance of the approach, as a fraction of the scene's radius
  let time = story.rest;
  let playing = false;
  let begun = false; // whether the user has chosen a time

  // Places the hand at a touch, or a part of its approach away: 1 is all of it. An arm follows.
  function pose(touch, away) {
    const frames = touch.arm || [];
    const distance = away * (frames.length ? touch.distance : APPROACH * eye.reach);
    const back = new THREE.Vector3().fromArray(touch.direction).multiplyScalar(-distance);
    const place = Math.min(away, 1) * (frames.length - 1);
    const one = frames[Math.floor(place)], other = frames[Math.ceil(place)];
    const part = place - Math.floor(place);
    toucher.children.forEach((child, link) => {
      const arm = link - touch.links.length;
      if (arm < 0) {
        child.matrix.fromArray(touch.links[link]);
        child.matrix.setPosition(new THREE.Vector3().setFromMatrixPosition(child.matrix).add(back));
      } else child.matrix.fromArray(one[arm].map((x, k) => x + part * (other[arm][k] - x)));
    });
  }

  // The picture is a function of the time and the ticked layers: contacts and estimate up to that
  // time, and the true object during the lift.
  function show() {
    const now = story.at(time);
    const on = (id) => (wanted.get(id) ? 1 : 0);
    const seen = new Map();
    const put = (id, group, opacity) => {
      fade(group, opacity);
      seen.set(id, seen.get(id) || opacity > 0.01);
    };
    const lifting = now.lift > 0 && wanted.get("lift");
    const s = lifting ? Math.min(1, now.lift / Math.min(0.5, 0.2 * story.lasts)) : 0;
    const truth = s * s * (3 - 2 * s);
    // Without the true object the estimate moves in the lift.
    const estimated = wanted.get("truth") ? 1 - truth : 1;
    const latest = surfaces.filter(({ count }) => now.surface !== null && count <= now.surface).pop();
    for (const surface of surfaces) put("estimate", surface.group, surface === latest ? on("estimate") * estimated : 0);
    for (const id of ["contacts", "normals"]) {
      if (!layers[id]) continue;
      reveal(layers[id], now.contacts, now.name === "touch");
      put(id, layers[id], now.contacts ? on(id) * estimated : 0);
    }
    if (layers.free) put("free", layers.free, now.name === "touch" ? 0 : on("free") * (1 - truth));
    for (const id of VIEW) {
      if (layers[id]) put(id, layers[id], on(id) * estimated);
    }
    for (const id of ["search", "motion"]) {
      if (layers[id]) put(id, layers[id], now.name === "touch" ? on(id) : 0);
    }
    for (const id of BESIDE) {
      if (layers[id]) put(id, layers[id], on(id));
    }
    if (layers.truth) {
      // Glass round contacts alone, too. Solid at once behind the fading estimate: two transparent
      // surfaces would flicker.
      const solid = truth > 0 || (surfaces.length ? !on("estimate") : !has("contacts") && !has("search"));
      put("truth", layers.truth, on("truth") * (solid ? 1 : 0));
      put("truth", layers.glass, on("truth") * (solid ? 0 : 1));
    }
    const together = wanted.get("together") && now.name === "grasp";
    grasps.forEach((group, k) => {
      const turn = together || now.rank === k + 1;
      put(`grasp-${k + 1}`, group, turn && !lifting && on("hand") ? on(`grasp-${k + 1}`) : 0);
    });
    eye.place(time);
    const touch = scene.touches[now.next - 1];
    if (touch) {
      pose(touch, now.away);
      const palm = new THREE.Vector3().setFromMatrixPosition(toucher.children[0].matrix);
      fade(toucher, on("hand") * eye.clearness(palm));
    } else if (toucher) fade(toucher, 0);
    fade(layers.hand, lifting ? on("hand") : 0); // only one of the hands is visible
    seen.set("hand", on("hand") && (lifting || [...grasps, toucher].some((group) => group?.visible)));
    seen.set("lift", lifting);
    if (story.lasts) viewer.animator.seek(lifting ? now.lift : 0);
    describe(now, seen);
    viewer.set_dirty();
  }

  // Updates caption and time line; layers that are not shown at this time turn pale.
  function describe(now, seen) {
    for (const input of document.querySelectorAll("[data-layer]")) {
      const pale = input.checked && seen.get(input.dataset.layer) === false;
      input.closest("li").classList.toggle("pale", pale);
    }
    for (const chip of document.querySelectorAll("[data-chip]")) {
      chip.hidden = !wanted.get(chip.dataset.chip);
      chip.classList.toggle("pale", seen.get(chip.dataset.chip) === false);
    }
    document.querySelector(".scale")?.classList.toggle("pale", seen.get("estimate") === false);
    if (!story.duration) return;
    element("time").value = String(time);
    element("clock").textContent = `${time.toFixed(1)} / ${story.duration.toFixed(1)} s`;
    const words = story.caption(now, (rank) => facts.get(`grasp-${rank}`).note);
    element("caption").textContent = words;
    element("time").setAttribute("aria-valuetext", words);
    document.querySelectorAll("[data-chapter]").forEach((button, k) => {
      button.setAttribute("aria-current", String(story.chapters[k].name === now.name));
    });
    const ended = !playing && time >= story.duration;
    element("play").className = playing ? "playing" : ended ? "ended" : "";
    element("play").setAttribute("aria-label", playing ? "Pause" : ended ? "Play again" : "Play");
  }

  function seek(moment) {
    time = Math.min(story.duration, Math.max(0, moment));
    begun = true;
    show();
  }

  function toggle() {
    playing = !playing;
    if (playing && (!begun || time >= story.duration)) time = 0;
    begun = true;
    let last = null;
    const step = (now) => {
      if (!playing) return;
      // A page that was hidden for a while continues where it was.
      if (last !== null) time = Math.min(story.duration, time + Math.min(0.25, (now - last) / 1000));
      last = now;
      if (time >= story.duration) playing = false;
      show();
      requestAnimationFrame(step);
    };
    if (playing) requestAnimationFrame(step);
    show();
  }

  function setUpPlayer() {
    if (!story.duration) return;
    for (const action of viewer.animator.actions) action.play(); // required for seeking
    element("play").addEventListener("click", toggle);
    element("time").addEventListener("input", (event) => {
      playing = false;
      seek(Number(event.target.value));
    });
    document.querySelectorAll("[data-chapter]").forEach((button, k) => {
      button.addEventListener("click", () => seek(story.chapters[k].start + (k ? 1e-3 : 0)));
    });
    window.addEventListener("keydown", (event) => {
      if (event.code !== "Space" || event.target.closest("button, input, summary")) return;
      event.preventDefault();
      toggle();
    });
  }

  // ---- the page's address ----------------------------------------------------------------
  // Missing parts take their initial values.
  function readAddress() {
    const asked = new URLSearchParams(location.hash.slice(1));
    const number = (key, otherwise) => {
      const value = Number.parseFloat(asked.get(key));
      return Number.isFinite(value) ? value : otherwise;
    };
    const chosen = asked.has("layers") ? new Set(asked.get("layers").split(",")) : null;
    for (const [id, { on }] of facts) wanted.set(id, chosen ? chosen.has(id) : on);
    begun = asked.has("t");
    time = Math.min(story.duration, Math.max(0, number("t", story.rest)));
    const { azimuth, elevation } = scene.camera;
    eye.view = {
      azimuth: number("azimuth", azimuth),
      elevation: number("elevation", elevation),
      zoom: Math.max(0.05, number("zoom", 1)),
    };
    const small = window.innerWidth <= 640 || window.innerHeight <= 480;
    element("panel").open = asked.has("panel") ? asked.get("panel") === "1" : !small;
    document.body.classList.toggle("bare", asked.get("panel") === "0");
    playing = false;
    for (const input of document.querySelectorAll("[data-layer]")) input.checked = wanted.get(input.dataset.layer);
    // A page that is opened as it is plays; frames, addresses with a view, and quiet systems do not.
    const still = window.top !== window || location.hash || matchMedia("(prefers-reduced-motion: reduce)").matches;
    return asked.get("play") === "1" || !still;
  }

  const graspShown = () => wanted.get("hand") && [...wanted].some(([id, on]) => on && id.startsWith("grasp-"));
  const frame = () => {
    eye.frame(graspShown(), time);
    show(); // opacities depend on the camera
  };
  const start = () => {
    const play = readAddress();
    show();
    frame();
    if (play && story.duration) toggle();
  };

  setUpRenderer();
  const eye = Eye(viewer, scene, story);
  gatherLayers();
  setUpPlayer();
  start();
  window.addEventListener("resize", () => { if (eye.touched) viewer.set_3d_pane_size(); else frame(); });
  window.addEventListener("hashchange", start);
  element("panel").addEventListener("toggle", () => { if (!eye.touched) frame(); });
  for (const input of document.querySelectorAll("[data-layer]")) {
    input.addEventListener("change", () => {
      const id = input.dataset.layer;
      wanted.set(id, input.checked);
      const rank = Number(id.split("-")[1]); // shows the ticked grasp
      if (input.checked && rank && !playing && !wanted.get("together")) seek(story.turnOf(rank));
      else show();
    });
  }
  // For a page that follows a run, shows this one in a frame, and goes on in the next one.
  window.lisGrasp = { eye, get now() { return { open: element("panel").open, ...story.place(time) }; } };
  document.body.dataset.ready = "true";
})();
