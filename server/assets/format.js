// Numbers and times as people read them.

/** With so many decimals, "-0.0" written as "0.0". */
export function fixed(value, decimals) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "-";
  const text = value.toFixed(decimals);
  return Number(text) === 0 ? (0).toFixed(decimals) : text.replace("-", "−");
}

/** Mean and standard error. */
export function estimate(e) {
  return e ? `${fixed(e.mean, 4)} ± ${fixed(e.se, 4)}` : "-";
}

/** With so many significant digits. */
export function digits(value, count = 3) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "-";
  return String(Number(value.toPrecision(count))).replace("-", "−");
}

/** A whole number with thin spaces between thousands. */
export function whole(value) {
  return value === null || value === undefined ? "-" : String(value).replace(/\B(?=(\d{3})+$)/g, "\u202f");
}

/** Seconds as a person says them. */
export function span(seconds) {
  if (seconds === null || seconds === undefined) return "-";
  const all = Math.max(0, Math.round(seconds));
  const [hours, minutes, rest] = [Math.floor(all / 3600), Math.floor(all / 60) % 60, all % 60];
  if (all < 10) return `${Math.max(0, seconds).toFixed(1)} s`;
  if (all < 60) return `${rest} s`;
  if (all < 3600) return `${minutes} min ${String(rest).padStart(2, "0")} s`;
  if (all < 172800) return `${hours} h ${String(minutes).padStart(2, "0")} min`;
  return `${Math.round(all / 86400)} days`;
}

/** A time of the coordinator, here. */
export function when(text) {
  const time = new Date(text);
  return Number.isNaN(time.getTime()) ? "-" : time.toLocaleString(undefined, { dateStyle: "medium", timeStyle: "short" });
}

/** "frequency_hz" and its kin as symbol with unit. */
export function symbol(parameter) {
  return parameter.unit ? `${parameter.symbol} [${parameter.unit}]` : parameter.symbol;
}

/** "sweep_mean_deg" in words. */
export function words(name) {
  return name.replace(/_(deg|hz)$/, "").replaceAll("_", " ");
}

/** States of a study which do not end by themselves. */
export const MOVING = ["sampling", "training", "optimising", "verifying", "refining"];
/** States which are the end. */
export const ENDED = ["succeeded", "failed", "cancelled"];
