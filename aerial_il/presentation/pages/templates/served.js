// What pages do alike that ask the server which handed them out.
const $ = (id) => document.getElementById(id), token = new URLSearchParams(location.search).get("token");
const given = JSON.parse($("data").textContent);

async function ask(path, body) {
  const answer = await fetch(`${path}?token=${encodeURIComponent(token)}`, { method: "POST", body: JSON.stringify(body) });
  if (!answer.ok) throw new Error(await answer.text());
  return answer;
}

