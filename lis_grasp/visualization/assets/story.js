// The time line: what is shown at a time, and its caption. No 3D here.
const Story = (facts) => {
  "use strict";
  const { chapters, duration, rest } = facts;
  const chapter = (name) => chapters.find((c) => c.name === name);
  const [touch, grasp, lift] = ["touch", "grasp", "lift"].map(chapter);

  // What there is at a moment. A chapter shows what happens just after its start, up to its end.
  //   name      of the chapter, "" where there is no story
  //   contacts  how many there are so far
  //   next      the touch that is being made, or was just made; 0 for none
  //   away      how far the hand still is from it: 1 at first, 0 when it touches
  //   surface   from how many contacts the latest estimate is made; null before the first one
  //   rank      of the grasp whose turn it is, 0 for none
  //   lift      how long the lift has been going on [s]
  function at(time) {
    const now = { name: "", contacts: Infinity, next: 0, away: 0, surface: Infinity, rank: 1, lift: 0 };
    if (!chapters.length) return now;
    const current = chapters.reduce((found, c) => (time > c.start ? c : found));
    const gone = time - current.start;
    now.name = current.name;
    if (current === touch) {
      now.contacts = Math.min(touch.contacts, Math.floor(gone / touch.step + 1e-6));
      // The hand comes in, is there when the contact appears, and stays for a moment.
      const turn = gone / touch.step;
      const next = Math.floor(turn + 0.6);
      if (next <= touch.contacts) Object.assign(now, { next, away: Math.max(0, (next - turn) / 0.6) ** 2 });
      now.surface = touch.surfaces.filter((count) => count <= now.contacts).pop() ?? null;
      now.rank = 0;
    }
    // From the worst one to the best one, which then lifts.
    if (current === grasp) now.rank = Math.max(1, grasp.grasps - Math.floor(gone / grasp.step));
    if (current === lift) now.lift = gone;
    return now;
  }

  function caption(now, noteOf) {
    if (now.name === "touch") {
      if (!now.contacts) return "No contacts yet";
      const made = now.surface === null ? "" : `; estimate from ${now.surface}`;
      return `Touch ${now.contacts} of ${touch.contacts}${made}`;
    }
    if (now.name === "grasp") {
      const best = now.rank === 1 ? ", the best" : "";
      return `Grasp ${now.rank} of ${grasp.grasps}${best}; ${noteOf(now.rank)}`;
    }
    return now.name === "lift" ? "The best grasp lifts the true object" : "";
  }

  // A moment at which it is a grasp's turn.
  const turnOf = (rank) => (grasp ? grasp.start + (grasp.grasps - rank + 0.5) * grasp.step : rest);

  // How far into a chapter a moment is [s]; negative before it, or without it.
  const into = (name, time) => (chapter(name) ? time - chapter(name).start : -1);

  return { at, caption, turnOf, into, chapters, duration, rest, lasts: lift ? lift.end - lift.start : 0 };
};
