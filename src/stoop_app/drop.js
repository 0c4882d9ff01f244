// A place to drop a log on: the browser streams it to the app.
const files = async (entry) => {
  if (entry.isFile) return [await new Promise((yes, no) => entry.file(yes, no))]
  const reader = entry.createReader(), out = []
  for (;;) {
    const some = await new Promise((yes, no) => reader.readEntries(yes, no))
    if (!some.length) return out
    for (const one of some) if (one.isFile) out.push(...await files(one))
  }
}
export function render({ model }) {
  const zone = document.createElement("label"), input = document.createElement("input"), text = document.createElement("span")
  zone.tabIndex = 0
  zone.className = "drop"
  text.textContent = "Drop a flight log here (or a folder of CSV tables), or click to choose"
  input.type = "file"; input.multiple = true; input.style.display = "none"; input.setAttribute("aria-label", "flight log")
  zone.append(text, input)
  const send = async (list, into) => {
    model.failed = ""
    let place = ""
    for (const [i, file] of list.entries()) {
      text.textContent = `sending ${file.name} (${i + 1} of ${list.length}, ${(file.size / 1e6).toFixed(1)} MB)`
      try {
        const asked = await fetch("upload?" + new URLSearchParams({ size: file.size }))
        if (!asked.ok) { text.textContent = "Drop a flight log here"; model.failed = file.name + ": " + await asked.text(); return }
        const query = new URLSearchParams({ name: file.name, into })
        const answer = await fetch("upload?" + query, { method: "POST", body: file })
        const said = await answer.text()
        if (!answer.ok) { text.textContent = "Drop a flight log here"; model.failed = file.name + ": " + said; return }
        place = said
      } catch (error) {
        text.textContent = "Drop a flight log here"
        model.failed = file.name + ": not kept; it is too large, changed while it was sent, or the app has ended"
        return
      }
    }
    text.textContent = "reading " + place
    model.placed = place
  }
  input.onchange = () => send([...input.files], input.files.length > 1 ? "tables" : "")
  zone.ondragover = (e) => { e.preventDefault(); zone.style.borderColor = "var(--accent)" }
  zone.ondragleave = () => { zone.style.borderColor = "var(--line)" }
  zone.ondrop = async (e) => {
    e.preventDefault()
    zone.style.borderColor = "var(--line)"
    const entries = [...e.dataTransfer.items].map((item) => item.webkitGetAsEntry()).filter((entry) => entry)
    const list = (await Promise.all(entries.map(files))).flat()
    const folder = entries.find((entry) => entry.isDirectory)
    if (list.length) send(list, folder ? folder.name : list.length > 1 ? "tables" : "")
  }
  return zone
}
