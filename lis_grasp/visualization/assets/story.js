// The time line: what is shown at a time, and its caption. No 3D here.
const Story = (facts) => {
  "use strict";
  const { chapters, duration, rest } = facts;
  const chapter = (name) => chapters.find((c) => c.name === name);
  const [touch, grasp, lift] = ["touch", "grasp", "lift"].map(chapter);

  // State at a time. A chapter includes its end, but not its start.
  //   name      of the chapter, "" for a static scene
  //   made      number of touches so far
  //   contacts  number of contacts that are shown: those of the latest estimate, if there is one
  //   next      number of the current touch; 0 for none
  //   away      remaining part of the approach: 1 at first, 0 at the touch
  //   surface   number of contacts of the latest estimate; null before the first one
  //   rank      of the shown grasp, 0 for none
  //   lift      time since the start of the lift [s]
  function at(time) {
    const now = { name: "", made: Infinity, contacts: Infinity, next: 0, away: 0, surface: Infinity, rank: 1, lift: 0 };
    if (!chapters.length) return now;
    const current = chapters.reduce((found, c) => (time > c.start ? c : found));
    const gone = time - current.start;
    now.name = current.name;
    if (current === touch) {
      now.made = Math.min(touch.contacts, Math.floor(gone / touch.step + 1e-6));
      // The hand approaches, touches when the contact appears, and stays for a moment.
      const turn = gone / touch.step;
      const next = Math.min(touch.contacts, Math.floor(turn + 0.6)); // the last one stays
      Object.assign(now, { next, away: Math.max(0, (next - turn) / 0.6) ** 2 });
      now.surface = touch.surfaces.filter((count) => count <= now.made).pop() ?? null;
      now.contacts = now.surface ?? now.made;
      now.rank = 0;
    }
    // From the worst to the best one.
    if (current === grasp) now.rank = Math.max(1, grasp.grasps - Math.floor(gone / grasp.step));
    if (current === lift) now.lift = gone;
    return now;
  }

  function caption(now, noteOf) {
    if (now.name === "touch") {
      if (!now.made) return "No contacts yet";
      const made = now.surface === null ? "" : `; estimate from the first ${now.surface}`;
      return `Touch ${now.made} of ${touch.contacts}${made}`;
    }
    if (now.name === "grasp") {
      if (facts.postures) return facts.postures[now.rank - 1];
      const best = now.rank === 1 ? ", the best" : "";
      return `Grasp ${now.rank} of ${grasp.planned}${best}; ${noteOf(now.rank)}`;
    }
    return now.name === "lift" ? "Best grasp on the true object" : "";
  }

  // The chapter of a time, and the touches or seconds since its start.
  function place(time) {
    const current = chapters.reduce((found, c) => (time > c.start ? c : found), chapters[0]);
    return current && { chapter: current.name, turn: (time - current.start) / (current === touch ? touch.step : 1) };
  }

  // A time at which a grasp is shown.
  const turnOf = (rank) => (grasp ? grasp.start + (grasp.grasps - rank + 0.5) * grasp.step : rest);

  // Time since the start of a chapter [s]; negative before it or without it.
  const into = (name, time) => (chapter(name) ? time - chapter(name).start : -1);

  return { at, place, caption, turnOf, into, chapters, duration, rest, lasts: lift ? lift.end - lift.start : 0 };
};
