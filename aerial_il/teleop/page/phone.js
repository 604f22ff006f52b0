// A phone that is moved in the hand: where it is, by WebXR or by its orientation sensor, while its clutch is held.

export const CLUTCH = "phone:clutch";

export class Phone {
  constructor() { this.latest = null; this.session = null; this.working = ""; }

  // Begin to read it; a browser asks for a gesture, so this is called by a button. Returns what is read, or throws.
  async begin() {
    if (!isSecureContext) throw new Error("A phone's pose needs a page over https: start with expose=true.");
    if (await navigator.xr?.isSessionSupported?.("immersive-ar").catch(() => false)) return this.beginPose();
    return this.beginOrientation();
  }

  async beginPose() {
    this.session = await navigator.xr.requestSession("immersive-ar", { optionalFeatures: ["dom-overlay"], domOverlay: { root: document.body } });
    const layer = document.createElement("canvas").getContext("webgl", { xrCompatible: true });
    await this.session.updateRenderState({ baseLayer: new XRWebGLLayer(this.session, layer) });
    const space = await this.session.requestReferenceSpace("local");
    const each = (_, frame) => {
      const pose = frame.getViewerPose(space)?.transform;
      this.latest = pose ? { position: xyz(pose.position), orientation: [...xyz(pose.orientation), pose.orientation.w] } : null;
      this.session?.requestAnimationFrame(each);
    };
    this.session.addEventListener("end", () => { this.session = null; this.latest = null; this.working = ""; });
    this.session.requestAnimationFrame(each);
    this.working = "pose";
    return this.working;
  }

  async beginOrientation() {
    const asked = await globalThis.DeviceOrientationEvent?.requestPermission?.();
    if (asked && asked !== "granted") throw new Error("The phone's orientation was not allowed.");
    addEventListener("deviceorientation", ({ alpha, beta, gamma }) => {
      this.latest = [alpha, beta, gamma].every(Number.isFinite) ? { angles: [alpha, beta, gamma] } : null;
    });
    this.working = "orientation";
    return this.working;
  }

  pose() { return this.latest; }

  // A button that begins to read it, and the clutch that is held then.
  buttons(touch) {
    const [start, clutch] = ["use the phone", "hold to move"].map((text) => {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = text;
      return button;
    });
    start.id = "phone-start";
    clutch.id = "phone-clutch";
    clutch.hidden = true;
    touch.button(clutch, CLUTCH);
    start.addEventListener("click", () => this.begin().then(
      () => { start.hidden = true; clutch.hidden = false; },
      (problem) => { start.textContent = problem.message; },
    ));
    return [start, clutch];
  }
}

function xyz({ x, y, z }) { return [x, y, z]; }
