// Driving: the robot follows its path, and replans where the world has changed.

class Drive {
  constructor(states) {
    this.state = states[0];
    this.follow(states);
    this.last = performance.now();
  }

  follow(states) {
    this.states = states;
    this.clock = pathClock(states);
    this.at = 0;
  }

  advance(now) {
    this.at += (Number($("speed").value) || 1) * Math.min(0.1, (now - this.last) / 1000);
    this.last = now;
    this.state = stateAlong(this.states, this.clock, this.at);
    return this.at < this.clock.at(-1);
  }
}

function togglePlay() {
  if (playing) stopPlaying();
  else if (scene.path && !scene.path.partial) {
    playing = new Drive(scene.path.states);
    settle = 0;
    showPlays(true);
  }
  dirty = true;
}

function stopPlaying() {
  if (!playing) return;
  playing = null;
  showPlays(false);
  changed();
}

function showPlays(on) {
  $("play").setAttribute("aria-pressed", String(on));
  $("play").textContent = on ? "Stop" : "Play";
}
