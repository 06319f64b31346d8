"use strict";
// One comparison: two pictures of the same held-out view, one drawn over the other up to a seam.
function makeSlider(root, capture) {
  const find = (name) => root.querySelector(name);
  const stage = find(".stage"), range = find(".slide");
  const view = find("select.view"), left = find("select.left"), right = find("select.right");
  const option = (value, text) => Object.assign(document.createElement("option"), { value, textContent: text });
  capture.views.forEach((name) => view.append(option(name, name)));
  capture.lanes.forEach((lane) => {
    left.append(option(lane.id, lane.name));
    right.append(option(lane.id, lane.name));
  });
  [left.value, right.value] = capture.start;
  view.value = capture.first;
  const name = (id) => capture.lanes.find((lane) => lane.id === id).name;
  const score = (id) => {
    const text = (capture.scores[id] || {})[view.value];
    return text ? `${name(id)}: ${text}. ` : "";
  };
  function draw() {
    const pictures = capture.pictures[view.value];
    find(".over").src = pictures[left.value];
    find(".under").src = pictures[right.value];
    find(".over").alt = `${name(left.value)}, view ${view.value}`;
    find(".under").alt = `${name(right.value)}, view ${view.value}`;
    find(".tag-left").textContent = name(left.value);
    find(".tag-right").textContent = name(right.value);
    find(".scores").textContent = score(left.value) + (left.value === right.value ? "" : score(right.value));
  }
  const move = () => stage.style.setProperty("--cut", `${range.value / 10}%`);
  range.addEventListener("input", move);
  // the seam follows a mouse or finger anywhere on the picture, not only on the invisible thumb
  const follow = (event) => {
    const box = stage.getBoundingClientRect();
    range.value = Math.round(1000 * Math.min(1, Math.max(0, (event.clientX - box.left) / box.width)));
    move();
  };
  range.addEventListener("pointerdown", follow);
  range.addEventListener("pointermove", (event) => { if (event.buttons) follow(event); });
  [view, left, right].forEach((control) => control.addEventListener("change", draw));
  draw();
  move();
}
