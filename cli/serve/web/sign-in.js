// The sign-in page of a server that other machines can reach.
const form = document.getElementById('form');

form.addEventListener('submit', async (event) => {
  event.preventDefault();
  const password = document.getElementById('password').value;
  const response = await fetch('/sign-in', {
    method: 'POST', headers: {'Content-Type': 'application/json'}, body: JSON.stringify({password}),
  });
  if (response.ok || response.redirected) location.replace('/');
  else document.getElementById('answer').textContent = await response.text();
});
