"use strict";

const drop = document.getElementById("drop");
const upload = document.getElementById("upload");
const told = document.getElementById("told");
const limits = upload.dataset;
document.getElementById("hint").append(" Or drop the folder here; other files in it stay where they are.");

function tell(words, refused = false) {
  told.textContent = words;
  told.className = refused ? "refused" : "";
}

const used = name => limits.suffixes.split(" ").some(suffix => name.toLowerCase().endsWith(suffix));
const hidden = place => place.split("/").some(part => part.startsWith("."));

// Files as [place, file]; what no session uses, as a README, is not sent.
async function send(found) {
  const files = found.filter(([place]) => used(place) && !hidden(place));
  const megabytes = files.reduce((sum, [, file]) => sum + file.size, 0) / 1e6;
  if (files.length === 0) return tell("There is no file of a session in it.", true);
  if (files.length > limits.files || megabytes > limits.megabytes)
    return tell(`${files.length} files, ${Math.ceil(megabytes)} MB: more than is taken.`, true);
  const form = new FormData();
  form.append("token", upload.elements.token.value);
  for (const [place, file] of files) form.append("files", file, place);
  tell(`Sending ${files.length} files, ${megabytes.toFixed(1)} MB, and checking them`);
  try {
    const answer = await fetch(upload.action, { method: "POST", body: form, headers: { Accept: "application/json" } });
    if (answer.ok) return location.assign((await answer.json()).location);
    const page = new DOMParser().parseFromString(await answer.text(), "text/html");
    tell(page.querySelector(".subtitle")?.textContent ?? `Refused (${answer.status}).`, true);
  } catch {
    tell("The connection broke off: is fringecal serve still running?", true);
  }
}

upload.addEventListener("submit", event => {
  event.preventDefault();
  send([...upload.elements.files.files].map(file => [file.webkitRelativePath || file.name, file]));
});

const fileOf = entry => new Promise((resolve, reject) => entry.file(resolve, reject));

async function entriesOf(folder) {
  const reader = folder.createReader();
  const all = [];
  for (;;) { // browsers hand out a hundred at a time
    const some = await new Promise((resolve, reject) => reader.readEntries(resolve, reject));
    if (some.length === 0) return all;
    all.push(...some);
  }
}

async function walk(entry, depth = 0) {
  const place = entry.fullPath.replace(/^\//, "");
  if (entry.isFile) return [[place, await fileOf(entry)]];
  if (depth > 2) return [];
  return (await Promise.all((await entriesOf(entry)).map(one => walk(one, depth + 1)))).flat();
}

for (const name of ["dragover", "dragleave", "drop"]) {
  drop.addEventListener(name, event => {
    event.preventDefault();
    drop.classList.toggle("over", name === "dragover");
  });
}
drop.addEventListener("drop", async event => {
  const entries = [...event.dataTransfer.items].map(item => item.webkitGetAsEntry()).filter(Boolean);
  send((await Promise.all(entries.map(entry => walk(entry)))).flat());
});
