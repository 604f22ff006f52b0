// What the observation says as numbers to fly by: a row a reading, each number with the word for where it points.

export function buildNumbers(table, readings) {
  table.replaceChildren(...readings.map(({ title, poles, unit }) => {
    const row = document.createElement("tr"), head = document.createElement("th");
    head.scope = "row";
    head.textContent = unit === "°" || unit === "%" ? title : `${title}, ${unit}`;
    row.append(head, ...poles.map(() => document.createElement("td")));
    return row;
  }));
}

export function drawNumbers(table, readings, numbers) {
  let at = 0;
  readings.forEach(({ poles, unit }, row) => poles.forEach(([plus, minus], i) => {
    const shown = spoken(numbers[at++], plus, minus, unit), cell = table.rows[row].cells[i + 1];
    if (cell.textContent !== shown) cell.textContent = shown;
  }));
}

function spoken(number, plus, minus, unit) {
  const sign = unit === "°" || unit === "%" ? unit : "", digits = sign || unit === "°/s" ? 0 : 1;
  if (!plus) return number.toFixed(digits) + sign;
  const word = plus === minus ? plus : number === 0 ? "" : number < 0 ? minus : plus;
  return `${word} ${Math.abs(number).toFixed(digits)}${sign}`.trim();
}
