"use strict";

const log = document.getElementById("log");
const now = document.getElementById("now");
const progress = new EventSource(log.dataset.progress);

progress.addEventListener("line", event => {
  const line = JSON.parse(event.data);
  log.append(`${line}\n`);
  log.scrollTop = log.scrollHeight;
  if (line.trim()) now.textContent = line.trim();
});
progress.addEventListener("end", () => {
  progress.close();
  location.reload();
});
