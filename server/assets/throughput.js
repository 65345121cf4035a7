// How many results came in when.

import { get } from "./api.js";
import { calm, card } from "./dom.js";
import { chart, colour } from "./charts.js";
import { digits, span, whole } from "./format.js";

/** Results over time. */
export function throughputCard(id) {
  const plot = chart("No result yet.");
  const load = calm(async () => {
    const view = await get(`/v1/studies/${id}/throughput`);
    if (!view.from) return;
    const begin = new Date(view.from).getTime();
    const x = view.results.map((_, i) => new Date(begin + (i + 0.5) * 1000 * view.interval_s));
    const y = view.results.map((n) => n / view.interval_s);
    const sum = view.results.reduce((a, b) => a + b, 0);
    // Time in which nothing was flown, such as before an optimisation was added, is no part of the mean.
    const busy = view.busy_s ?? view.results.length * view.interval_s;
    plot.show(() => ({
      traces: [{ x, y, type: "bar", marker: { color: colour("c1") }, hovertemplate: "%{y:.3g}/s at %{x|%H:%M:%S}<extra></extra>" }],
      layout: { height: 230, bargap: 0, yaxis: { title: "results per second", rangemode: "tozero" }, xaxis: {} },
    }), `${whole(sum)} results in ${span(busy)} of work, ${digits(sum / busy, 3)} per second on average; each bar is ${span(view.interval_s)}.`);
  }, 4000);
  let known = null;
  return {
    root: card("Throughput", plot.figure),
    update(study) {
      const count = JSON.stringify([study.samples, study.stage_jobs, study.state]);
      if (count === known) return;
      known = count;
      load();
    },
  };
}
