// The page of one replay: unpacks the trajectories and hands them to the player.
"use strict";

(async () => {
  const fail = (reason) => {
    const note = document.getElementById("failure");
    note.hidden = false;
    note.textContent = `The replay could not be drawn (${reason}).`;
  };
  window.addEventListener("error", (event) => fail(event.message));
  window.addEventListener("unhandledrejection", (event) => fail(event.reason));
  const data = JSON.parse(await sumoEval.inflated(document.getElementById("replay-data").textContent));
  const all = await sumoEval.decodeTrajectories(data.trajectories, data.channels);
  const views = data.views.map(({ name, vehicles, contact }) => ({
    name, contact, ego: all[vehicles.ego],
    actors: Object.entries(vehicles).filter(([vehicle]) => vehicle !== "ego").map(([vehicle, k]) => [vehicle, all[k]]),
  }));
  const player = sumoReplay.player(document.getElementById("replay"));
  player.show({ road: data.road, bodies: data.bodies, views, ghosts: data.ghosts.map((k) => all[k]) });
  document.documentElement.dataset.replay = "ready";
})();
