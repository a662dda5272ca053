'use strict';
(() => {
  const dashes = [[], [8, 4], [2, 3], [8, 3, 2, 3], [14, 4], [4, 2]];
  const style = () => getComputedStyle(document.documentElement);
  const charts = [];

  const superscript = (number) =>
    String(number).replace(/./g, (c) => (c === '-' ? '⁻' : '⁰¹²³⁴⁵⁶⁷⁸⁹'[Number(c)]));
  const minus = (text) => text.replace('-', '−');
  const short = (value) => {
    const size = Math.abs(value);
    if (size !== 0 && (size < 1e-3 || size >= 1e6)) {
      const [digits, power] = value.toExponential(3).split('e');
      return minus(String(Number(digits))) + ' × 10' + superscript(Number(power));
    }
    return minus(String(Number(value.toPrecision(5))));
  };
  const powerOfTen = (value) => {
    const power = Math.log10(value);
    return Math.abs(power - Math.round(power)) < 1e-6 ? '10' + superscript(Math.round(power)) : null;
  };

  // Names of the vertical lines, and the lines.
  const marks = {
    id: 'marks',
    afterDatasetsDraw(chart, args, options) {
      const { ctx, chartArea: area, scales } = chart;
      ctx.save();
      for (const mark of options.list) {
        const x = scales.x.getPixelForValue(mark.x);
        if (x < area.left - 1 || x > area.right + 1) continue;
        ctx.strokeStyle = ctx.fillStyle = style().getPropertyValue('--soft');
        ctx.setLineDash([]);
        ctx.lineWidth = 1;
        ctx.beginPath();
        ctx.moveTo(x, area.top);
        ctx.lineTo(x, area.bottom);
        ctx.stroke();
        ctx.font = '12px ' + style().getPropertyValue('--sans');
        const room = area.right - x > ctx.measureText(mark.name).width + 8;
        ctx.textAlign = room ? 'left' : 'right';
        ctx.textBaseline = 'top';
        ctx.fillText(mark.name, x + (room ? 5 : -5), area.top + 3);
      }
      ctx.restore();
    },
  };

  // One unit as long across as up: the smaller scale widens until it fits.
  const equal = {
    id: 'equal',
    afterLayout(chart, args, options) {
      if (!options.on) return;
      const { left, right, top, bottom } = chart.chartArea;
      const width = right - left;
      const height = bottom - top;
      if (width < 10 || height < 10) return;
      const [x0, x1, y0, y1] = options.extent;
      const unit = Math.max((x1 - x0) / width, (y1 - y0) / height);
      const set = (scale, low, high, pixels) => {
        const middle = (low + high) / 2;
        scale.min = middle - (unit * pixels) / 2;
        scale.max = middle + (unit * pixels) / 2;
      };
      const { x, y } = chart.options.scales;
      const before = [x.min, x.max, y.min, y.max];
      set(x, x0, x1, width);
      set(y, y0, y1, height);
      const far = [x.min, x.max, y.min, y.max].some((v, i) => !(Math.abs(v - before[i]) < unit * 0.5));
      if (far && (options.rounds = (options.rounds || 0) + 1) < 6) {
        chart.update('none');
      }
      options.rounds = 0;
    },
  };

  const theme = (chart) => {
    const css = style();
    const get = (name) => css.getPropertyValue(name).trim();
    for (const set of chart.data.datasets) {
      const colour = get(set.ww.colour);
      set.borderColor = colour;
      set.pointBackgroundColor = colour;
      set.pointBorderColor = colour;
      if (set.ww.area) {
        set.backgroundColor = colour + '38';
        set.borderColor = 'transparent';
      }
    }
    for (const axis of Object.values(chart.options.scales)) {
      axis.ticks.color = get('--soft');
      axis.title.color = get('--ink');
      axis.grid.color = get('--grid');
      axis.grid.borderColor = get('--faint');
    }
    const tip = chart.options.plugins.tooltip;
    tip.backgroundColor = get('--ink');
    tip.titleColor = tip.bodyColor = get('--paper');
  };

  const pairs = (x, y) => x.map((value, i) => ({ x: value === null ? NaN : value, y: y[i] }));

  const build = (figure) => {
    const data = JSON.parse(figure.querySelector('script').textContent);
    const sets = [];  // in the order of the legend; one entry may be two datasets
    const datasets = [];
    const line = (more) => ({ showLine: true, pointRadius: 0, pointHitRadius: 6, borderWidth: 2, spanGaps: false,
      borderJoinStyle: 'round', ...more });
    for (const set of data.sets) {
      const entry = line({
        label: set.name, data: pairs(set.x, set.y), order: set.ref ? 5 : 10,
        borderDash: set.ref ? [5, 4] : dashes[set.slot], borderWidth: set.ref ? 1.5 : 2,
        stepped: set.steps ? 'before' : false,
        ww: { colour: set.ref ? '--ref' : '--c' + set.slot },
      });
      if (set.points) Object.assign(entry, { showLine: false, pointRadius: 2.6, pointHoverRadius: 4 });
      sets.push([datasets.push(entry) - 1]);
    }
    for (const band of data.bands) {
      const area = { area: true, colour: '--c' + band.slot };
      const low = datasets.push(line({ label: band.name + ', lower edge', data: pairs(band.lowx, band.low),
        order: 30, borderWidth: 0, ww: area })) - 1;
      const high = datasets.push(line({ label: band.name + ', upper edge', data: pairs(band.highx, band.high),
        order: 30, borderWidth: 0, fill: low, ww: area })) - 1;
      sets.push([low, high]);
    }
    for (const level of data.levels) {
      sets.push([datasets.push(line({ label: level.name, order: 25, borderDash: [1.5, 3], borderWidth: 1.4,
        pointHitRadius: 0, data: [{ x: level.from, y: level.y }, { x: level.to, y: level.y }],
        ww: { colour: '--soft' } })) - 1]);
    }

    const axis = (from, more) => ({
      type: from.log ? 'logarithmic' : 'linear', min: from.min, max: from.max,
      title: { display: true, text: from.label, font: { size: 13 } },
      grid: { drawTicks: false },
      ticks: { padding: 6, maxRotation: 0, includeBounds: from.log, autoSkipPadding: 12, font: { size: 12 },
        ...(from.log ? { callback: powerOfTen } : { callback: (value) => short(value) }) },
      ...more,
    });
    const all = data.sets.flatMap((set) => set.x.map((x, i) => [x, set.y[i]]))
      .filter(([x, y]) => x !== null && y !== null);
    const span = (values, axis) => {
      const low = axis.min ?? values.reduce((a, b) => Math.min(a, b), Infinity);
      const high = axis.max ?? values.reduce((a, b) => Math.max(a, b), -Infinity);
      const margin = 0.04 * (high - low || 1);
      return [low - margin, high + margin];
    };
    // From the first value to the last, or from zero where that is near.
    const between = (axis) => {
      const values = data.sets.flatMap((set) => set.x).filter((x) => x !== null);
      if (!values.length) return {};
      const low = values.reduce((a, b) => Math.min(a, b));
      const high = values.reduce((a, b) => Math.max(a, b));
      if (low === high) return {};
      return { min: axis.min ?? (low > 0 && low < 0.05 * high ? 0 : low), max: axis.max ?? high };
    };
    const narrow = () => window.innerWidth < 600;
    const chart = new Chart(figure.querySelector('canvas'), {
      type: 'scatter',
      data: { datasets },
      plugins: [marks, equal],
      options: {
        animation: false, responsive: true, maintainAspectRatio: false, normalized: false,
        font: { family: style().getPropertyValue('--sans') },
        interaction: data.equal ? { mode: 'nearest', intersect: false }
          : { mode: 'nearest', axis: 'x', intersect: false },
        layout: { padding: { right: 8, top: 4 } },
        scales: {
          x: axis(data.x, data.equal ? {} : data.x.log ? { bounds: 'data' } : between(data.x)),
          y: axis(data.y, data.equal || data.y.min !== undefined ? {} : { grace: data.y.log ? 0 : '4%' }),
        },
        plugins: {
          legend: { display: false },
          marks: { list: data.marks },
          equal: { on: data.equal,
            extent: data.equal ? [...span(all.map((p) => p[0]), data.x), ...span(all.map((p) => p[1]), data.y)]
              : [] },
          tooltip: {
            displayColors: false, animation: false,
            filter: (item, i, items) => !item.dataset.ww.area
              && items.findIndex((other) => other.datasetIndex === item.datasetIndex) === i,
            callbacks: {
              title: (items) => (items.length ? data.x.label + ': ' + short(items[0].parsed.x) : ''),
              label: (item) => item.dataset.label + ': ' + short(item.parsed.y),
            },
          },
        },
      },
    });
    Chart.defaults.font.family = style().getPropertyValue('--sans');
    theme(chart);
    if (narrow()) chart.options.scales.x.ticks.maxTicksLimit = 6;
    chart.update('none');
    for (const button of figure.querySelectorAll('.legend button')) {
      button.addEventListener('click', () => {
        const show = button.getAttribute('aria-pressed') === 'false';
        button.setAttribute('aria-pressed', String(show));
        for (const i of sets[Number(button.dataset.set)]) chart.setDatasetVisibility(i, show);
        chart.update('none');
      });
    }
    charts.push(chart);
  };

  document.querySelectorAll('figure.chart').forEach(build);

  const again = () => charts.forEach((chart) => { theme(chart); chart.update('none'); });
  window.matchMedia('(prefers-color-scheme: dark)').addEventListener('change', again);
  const print = () => charts.forEach((chart) => { chart.resize(); theme(chart); chart.update('none'); });
  window.addEventListener('beforeprint', print);
  window.addEventListener('afterprint', print);
  window.matchMedia('print').addEventListener('change', print);
  const contents = document.querySelector('nav details');
  if (contents && window.innerWidth < 600) contents.open = false;
  window.reportCharts = charts;  // for whoever wants to look closer, the page's own tests among them
})();
