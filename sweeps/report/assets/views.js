"use strict";
// The 3-D view of one episode: the recovered body, the true one as wires, the contacts.
const stage = document.getElementById("stage");
if (stage) {
  const data = JSON.parse(document.getElementById("episodes").textContent);
  const solids = new Solids(stage);
  const about = document.getElementById("about");
  const shown = name => document.getElementById(`show-${name}`).checked;
  let current = 0;

  const draw = () => {
    const episode = data.episodes[current];
    const body = data.bodies[episode.object];
    body.metres ??= metres(body.points);
    body.quads ??= quads(body.faces);
    const things = [];
    if (shown("recovered")) things.push({colour: "--recovered",
      tints: episode.unsure && tints(episode.unsure), ...(episode.faces
        ? {points: metres(episode.surface), faces: quads(episode.faces)}
        : {points: metres(episode.grid), faces: gridFaces(episode.rows, episode.columns)})});
    if (shown("true")) things.push({points: body.metres, faces: body.quads, colour: "--soft",
      wire: true});
    if (shown("contacts")) things.push({points: metres(episode.contacts), colour: "--contact",
      dots: true});
    solids.show(things, frameOf(body.metres));
    const text = `${episode.strategy}, ${episode.place}: ${episode.object}, episode `
      + `${episode.episode}. Chamfer ${episode.chamfer_mm} mm, IoU ${episode.iou}, `
      + `${episode.status}.`
      + (episode.prior ? " Nothing was recovered: the body shown is the given prior." : "");
    about.textContent = text;
    stage.setAttribute("aria-label", `3-D view. ${text} Arrow keys turn it, plus and minus zoom.`);
  };

  const buttons = [...document.querySelectorAll("button[data-episode]")];
  for (const button of buttons) button.addEventListener("click", () => {
    current = Number(button.dataset.episode);
    for (const other of buttons) other.setAttribute("aria-pressed", String(other === button));
    draw();
  });
  for (const box of document.querySelectorAll("input[id^=show-]"))
    box.addEventListener("change", draw);
  draw();
}
