/* Start: read the data of the page, then bring its parts to life. The 3-D replay is loaded when it is asked for. */

function startReplay(host, group) {
  const poster = part(host, "poster"), button = part(host, "play");
  if (poster && group && group.maps.length) {
    const relief = new Relief(poster, group), map = group.maps[0];
    relief.bare = true;
    relief.show(map, map.layers.height, LAYERS.height, group.spans.height, null);
  } else if (poster) poster.remove();
  button.addEventListener("click", () => {
    const dark = matchMedia("(prefers-color-scheme: dark)").matches;
    let text = document.getElementById("recording").textContent.replaceAll("\u0001", "<");
    if (dark) text = text.replace("{darkMode:false}", "{darkMode:true}");
    const frame = node("iframe", { title: "Replay of the scan in 3-D", allowfullscreen: "" });
    frame.srcdoc = text;
    part(host, "stage").replaceChildren(frame);
    frame.focus();
  });
}

function start() {
  const data = JSON.parse(document.getElementById("surfuse-data").textContent);
  const groups = data.groups.map((raw) => readGroup(raw, data.words));
  for (const host of document.querySelectorAll("[data-explorer]")) new Explorer(host, groups[Number(host.dataset.explorer)]);
  for (const host of document.querySelectorAll("[data-side-by-side]")) new SideBySide(host, groups[Number(host.dataset.sideBySide)]);
  for (const host of document.querySelectorAll("[data-relief]")) startRelief(host, groups[Number(host.dataset.relief)]);
  for (const host of document.querySelectorAll("[data-comparison]")) new Comparison(host, groups[Number(host.dataset.comparison)]);
  for (const host of document.querySelectorAll("[data-replay]")) startReplay(host, groups[0]);
  addEventListener("beforeprint", () => { for (const detail of document.querySelectorAll("details")) detail.open = true; });
}

start();
