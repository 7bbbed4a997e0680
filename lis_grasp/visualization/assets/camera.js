// Camera views of the object, of the hand at the object, and of the lift, framed for the window.
const Eye = (viewer, scene, story) => {
  "use strict";
  const THREE = MeshCat.THREE;
  const element = (id) => document.getElementById(id);
  const vectors = (points) => points.map((p) => new THREE.Vector3(...p));
  const outline = scene.camera.object.concat(scene.camera.hand);
  const whole = outline.concat(scene.camera.arm);
  const box = new THREE.Box3().setFromPoints(vectors(whole));
  const middle = box.getCenter(new THREE.Vector3());
  const reach = box.getSize(new THREE.Vector3()).length() / 2;
  const ramp = (to, x) => { const s = Math.min(1, Math.max(0, x / to)); return s * s * (3 - 2 * s); };

  let view = null; // azimuth and elevation [deg], zoom
  let frames = null;
  let touched = false; // whether the user has moved the camera

  // The part of the window beside the overlay, in pixels.
  function freeArea() {
    const whole = { left: 0, top: 0, right: window.innerWidth, bottom: window.innerHeight };
    if (document.body.classList.contains("bare")) return whole;
    const panel = element("panel").getBoundingClientRect();
    const narrow = whole.right <= 640 || whole.bottom <= 480;
    if (!narrow && element("panel").open) whole.left = panel.right;
    else whole.top = Math.min(panel.bottom, 70);
    const dock = element("dock").getBoundingClientRect();
    if (dock.height) whole.bottom = Math.max(dock.top, whole.top + 80);
    return whole;
  }

  // The nearest camera in the chosen direction with all points inside the free area.
  function fit(points, axes, free) {
    const [right, up, back] = axes;
    const tangent = 0.9 * Math.tan(THREE.MathUtils.degToRad(viewer.camera.fov / 2)); // 0.9: a margin
    const tall = (tangent * (free.bottom - free.top)) / window.innerHeight;
    const wide = (tangent * (free.right - free.left)) / window.innerHeight;
    const target = middle.clone();
    let distance = 0;
    for (let round = 0; round < 20; round++) {
      distance = 0;
      const seen = vectors(points).map((r) => {
        r.sub(target);
        const q = { x: r.dot(right), y: r.dot(up), z: r.dot(back) };
        distance = Math.max(distance, q.z + Math.abs(q.x) / wide, q.z + Math.abs(q.y) / tall);
        return q;
      });
      let [x0, x1, y0, y1] = [Infinity, -Infinity, Infinity, -Infinity];
      for (const q of seen) { // projected on the plane through the target
        const scale = distance / (distance - q.z);
        x0 = Math.min(x0, q.x * scale); x1 = Math.max(x1, q.x * scale);
        y0 = Math.min(y0, q.y * scale); y1 = Math.max(y1, q.y * scale);
      }
      target.addScaledVector(right, (x0 + x1) / 2).addScaledVector(up, (y0 + y1) / 2);
    }
    return { target, distance };
  }

  // The arrows extend beyond the object's outline by about the first factor, fingers by the second.
  const wider = scene.touches.some((touch) => touch) ? 1.6 : 1.25;
  const centre = new THREE.Box3().setFromPoints(vectors(scene.camera.object)).getCenter(new THREE.Vector3());
  const withArrows = (p) => new THREE.Vector3(...p).sub(centre).multiplyScalar(wider).add(centre).toArray();

  const aimLights = Appearance.addLights(viewer.scene, middle, reach);

  // Finds the views for the window and the chosen direction.
  function frame(handShown, time) {
    const free = freeArea();
    const [width, height] = [window.innerWidth, window.innerHeight];
    const a = THREE.MathUtils.degToRad(view.azimuth);
    const e = THREE.MathUtils.degToRad(view.elevation);
    const back = new THREE.Vector3(Math.cos(e) * Math.cos(a), Math.cos(e) * Math.sin(a), Math.sin(e));
    const right = new THREE.Vector3(-Math.sin(a), Math.cos(a), 0);
    const axes = [right, new THREE.Vector3().crossVectors(back, right), back];
    Object.assign(viewer.camera, { fov: 28, near: 0.02 * reach, far: 60 * reach });
    const touch = fit(scene.camera.object.map(withArrows), axes, free);
    const grasp = handShown ? fit(outline, axes, free) : touch;
    const moved = scene.camera.moved;
    const lift = moved.length ? fit(whole.concat(moved), axes, free) : grasp; // with the arm's foot
    frames = { back, touch, grasp, lift };
    aimLights(view.azimuth);
    const [dx, dy] = [(free.left + free.right - width) / 2, (free.top + free.bottom - height) / 2];
    viewer.camera.setViewOffset(width, height, -dx, -dy, width, height);
    Object.assign(viewer.controls, { minDistance: 0.3 * reach, maxDistance: 20 * reach });
    touched = false;
    place(time);
    viewer.set_3d_pane_size();
  }

  // Interpolates the views by time; a camera that the user moved is kept.
  function place(time) {
    if (!frames || touched) return;
    const blend = (one, other, part) => ({
      target: one.target.clone().lerp(other.target, part),
      distance: THREE.MathUtils.lerp(one.distance, other.distance, part),
    });
    const chapter = story.at(time).name;
    const grasping = chapter === "touch" ? 0 : chapter === "grasp" && story.chapters[0].name === "touch" ? ramp(0.7, story.into("grasp", time)) : 1;
    const lifting = ramp(Math.min(0.4, 0.2 * story.lasts) || 1, story.into("lift", time));
    const { target, distance } = blend(blend(frames.touch, frames.grasp, grasping), frames.lift, lifting);
    const toViewer = (v) => new THREE.Vector3(v.x, v.z, -v.y); // z up to y up
    viewer.controls.target.copy(toViewer(target));
    viewer.camera.position.copy(toViewer(target.addScaledVector(frames.back, distance / view.zoom)));
    viewer.controls.update();
  }

  // Opacity of what is at a place: 1, or less between the camera and the object.
  function clearness(place) {
    const seen = viewer.camera.position;
    const towards = new THREE.Vector3(seen.x, -seen.z, seen.y).sub(centre).normalize();
    return 1 - 0.75 * ramp(0.4, place.clone().sub(centre).normalize().dot(towards) - 0.35);
  }

  viewer.controls.addEventListener("start", () => { touched = true; });

  return {
    frame, place, clearness, reach,
    get touched() { return touched; },
    // Where the user moved the camera; null if nowhere. Another page of the object can take it over.
    get held() { return touched ? { position: viewer.camera.position.toArray(), target: viewer.controls.target.toArray() } : null; },
    hold({ position, target }) {
      viewer.camera.position.fromArray(position);
      viewer.controls.target.fromArray(target);
      viewer.controls.update();
      touched = true;
      viewer.set_dirty();
    },
    set view(chosen) { view = chosen; },
  };
};
