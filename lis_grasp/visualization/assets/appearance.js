// Appearance: lights, fading, and the glass shell of the true object.
const Appearance = (() => {
  "use strict";
  const THREE = MeshCat.THREE;

  const meshes = (group) => {
    const found = [];
    group.traverse((o) => { if (o.material) found.push(o); });
    return found;
  };

  // Environment light: a bright room with soft boxes.
  function studio(renderer) {
    const room = new THREE.Scene();
    const wall = (colour, strength, size, position) => {
      const paint = new THREE.MeshBasicMaterial({ color: new THREE.Color(colour).multiplyScalar(strength), side: THREE.DoubleSide });
      const mesh = new THREE.Mesh(new THREE.BoxGeometry(...size), paint);
      mesh.position.set(...position);
      mesh.lookAt(0, 0, 0);
      room.add(mesh);
    };
    wall(0xffffff, 0.30, [40, 40, 40], [0, 0, 0]);
    wall(0xffffff, 2.4, [9, 9, 0.1], [0, 14, 2]);
    wall(0xfff4e6, 1.9, [6, 10, 0.1], [12, 6, 8]);
    wall(0xe8f0ff, 1.2, [6, 10, 0.1], [-13, 4, 2]);
    const generator = new THREE.PMREMGenerator(renderer);
    const texture = generator.fromScene(room, 0.03).texture;
    generator.dispose();
    return texture;
  }

  // Lights round `middle`, for a scene of radius `reach` [m]; returns what aims them.
  function addLights(scene, middle, reach) {
    const key = new THREE.DirectionalLight(0xfffaf2, 0.72);
    const fill = new THREE.DirectionalLight(0xeaf1ff, 0.15);
    key.target.position.copy(middle);
    key.castShadow = true;
    key.shadow.mapSize.set(2048, 2048);
    key.shadow.radius = 3;
    key.shadow.bias = -0.0004;
    key.shadow.normalBias = 0.004 * reach;
    const span = 2.2 * reach; // wide enough for the lift
    Object.assign(key.shadow.camera, { left: -span, right: span, top: span, bottom: -span, near: reach, far: 8 * reach });
    fill.target.position.copy(middle);
    scene.add(key, key.target, fill, fill.target);
    // From the right of the camera and from above.
    return (azimuth) => {
      const a = THREE.MathUtils.degToRad(azimuth);
      key.position.set(Math.cos(a + 0.7), Math.sin(a + 0.7), 1.7).setLength(4 * reach).add(middle);
      fill.position.set(Math.cos(a - 1.2), Math.sin(a - 1.2), 0.5).add(middle);
    };
  }

  // Shows a group with an opacity: 0 hides it, 1 is that of its materials.
  function fade(group, opacity) {
    group.visible = opacity > 0.01;
    for (const mesh of meshes(group)) {
      const own = mesh.material.userData;
      if (own.opacity === undefined) own.opacity = mesh.material.opacity;
      const transparent = opacity < 0.999 || own.opacity < 1 || own.glass === true;
      if (transparent !== mesh.material.transparent) {
        mesh.material.transparent = transparent;
        mesh.material.needsUpdate = true;
      }
      mesh.material.opacity = own.opacity * opacity;
    }
  }

  // Moves a surface slightly away from the camera, so that lines on it stay visible.
  function pushBack(material) {
    Object.assign(material, { polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 });
  }

  // Lets a faded group hide its own inside: only the surfaces that are nearest to the camera show.
  function hideInside(group) {
    for (const mesh of meshes(group).filter((o) => o.isMesh)) {
      const nearest = mesh.clone(false);
      nearest.material = Object.assign(mesh.material.clone(), { colorWrite: false });
      nearest.matrixAutoUpdate = true;
      for (const part of ["position", "quaternion", "scale"]) nearest[part].copy(new THREE.Object3D()[part]);
      nearest.castShadow = nearest.receiveShadow = false;
      nearest.renderOrder = 3;
      mesh.renderOrder = 4;
      for (const edges of mesh.children) edges.renderOrder = 4;
      mesh.add(nearest);
    }
  }

  function addEdges(mesh, color, opacity) {
    const material = new THREE.LineBasicMaterial({ color, opacity, transparent: true });
    mesh.add(new THREE.LineSegments(new THREE.EdgesGeometry(mesh.geometry, 35), material));
  }

  // A shell that is clear where it faces the camera and visible at its rim.
  function makeGlass(solid) {
    const glass = solid.clone(true);
    for (const mesh of meshes(glass)) {
      mesh.material = mesh.material.clone();
      mesh.castShadow = mesh.receiveShadow = false;
      mesh.renderOrder = 2;
      Object.assign(mesh.material, { depthWrite: false, side: THREE.FrontSide, roughness: 0.15 });
      mesh.material.userData = { opacity: 1, glass: true };
      mesh.material.polygonOffset = true;
      mesh.material.polygonOffsetFactor = mesh.material.polygonOffsetUnits = -1;
      mesh.material.onBeforeCompile = (shader) => {
        shader.fragmentShader = shader.fragmentShader.replace(
          "#include <dithering_fragment>",
          "float facing = abs(dot(normalize(vViewPosition), normal));\n" +
          "gl_FragColor.a *= mix(0.85, 0.10, smoothstep(0.0, 0.4, facing));\n#include <dithering_fragment>");
      };
      addEdges(mesh, mesh.material.color.clone().multiplyScalar(0.45), 0.8);
    }
    return glass;
  }

  // Bodies through which everything stays visible, with their edges.
  function makeClear(group) {
    for (const mesh of meshes(group)) {
      mesh.castShadow = mesh.receiveShadow = false;
      mesh.renderOrder = 1;
      Object.assign(mesh.material, { depthWrite: false, side: THREE.FrontSide });
      addEdges(mesh, mesh.material.color.clone().multiplyScalar(0.6), 0.6);
    }
  }

  // Prepares a group of many copies (InstancedMesh).
  function setUpCopies(group) {
    for (const mesh of meshes(group)) {
      mesh.castShadow = mesh.receiveShadow = false;
      mesh.frustumCulled = false; // its bounds are those of one copy
    }
  }

  // Shows the first `count` of many copies, the newest one larger.
  function reveal(group, count, pointOut) {
    for (const mesh of meshes(group)) {
      const own = mesh.userData;
      if (!own.matrices) own.matrices = mesh.instanceMatrix.array.slice();
      mesh.count = Math.min(count, own.matrices.length / 16);
      mesh.instanceMatrix.array.set(own.matrices);
      const newest = 16 * (mesh.count - 1);
      if (pointOut && mesh.count > 0) {
        for (const k of [0, 1, 2, 4, 5, 6, 8, 9, 10]) mesh.instanceMatrix.array[newest + k] *= 1.5;
      }
      mesh.instanceMatrix.needsUpdate = true;
    }
  }

  return { addEdges, addLights, fade, hideInside, makeClear, makeGlass, meshes, pushBack, reveal, setUpCopies, studio };
})();
