// The live page as a notebook's widget: the page in a frame, whose messages go by the notebook's comm.

class CommSocket {
  constructor(model) {
    this.model = model;
    this.readyState = WebSocket.OPEN;
    this.view = `${Date.now()}-${Math.random()}`;
    this.hear = ({view, frame}) => view === this.view && this.onmessage?.({data: frame});
    model.on("msg:custom", this.hear);
    queueMicrotask(() => this.onopen?.());
  }

  send(frame) {
    this.model.send({view: this.view, frame});
  }

  close() {
    this.model.off("msg:custom", this.hear);
    this.send(null);
  }
}

function render({model, el}) {
  const box = document.createElement("div"), picture = document.createElement("img"), frame = document.createElement("iframe");
  box.style.cssText = `position: relative; height: ${model.get("height")}px`;
  picture.style.cssText = "position: absolute; inset: 0; width: 100%; height: 100%; object-fit: contain; background: #fff";
  frame.style.cssText = "position: absolute; inset: 0; width: 100%; height: 100%; border: 0; visibility: hidden";
  picture.alt = "The world";
  picture.src = `data:image/svg+xml,${encodeURIComponent(model.get("picture"))}`;
  frame.title = "trailmark live";
  frame.allow = "clipboard-write";
  frame.srcdoc = model.get("page");
  let socket = null;
  // The page takes this in place of a WebSocket (link.js).
  frame.openSocket = () => {
    socket?.close();
    return (socket = new CommSocket(model));
  };
  // Without a kernel nobody answers, and the picture stays.
  const answered = () => {
    frame.style.visibility = "visible";
    picture.remove();
    model.off("msg:custom", answered);
  };
  model.on("msg:custom", answered);
  box.append(picture, frame);
  el.replaceChildren(box);
  return () => {
    model.off("msg:custom", answered);
    socket?.close();
  };
}

export default {render};
