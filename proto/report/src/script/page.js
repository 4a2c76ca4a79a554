// The page: light or dark, and a view for every plot.

const isDark = () => root.dataset.theme ? root.dataset.theme === 'dark' : matchMedia('(prefers-color-scheme: dark)').matches;
const remembered = theme => { try { if (theme === undefined) return localStorage.getItem('report-theme'); localStorage.setItem('report-theme', theme); } catch { return null; } };
const theme = document.createElement('button');
theme.type = 'button';
theme.className = 'theme';
const named = () => { theme.textContent = isDark() ? 'light' : 'dark'; theme.setAttribute('aria-label', 'show the page ' + theme.textContent); };
theme.addEventListener('click', () => { root.dataset.theme = isDark() ? 'light' : 'dark'; remembered(root.dataset.theme); named(); });
const kept = remembered();
if (kept === 'dark' || kept === 'light') root.dataset.theme = kept;
named();
document.querySelector('header').prepend(theme);

const views = [];
document.querySelectorAll('figure > svg[data-plot]').forEach(svg => views.push(new View(svg.parentElement, svg)));
let before = innerWidth;
addEventListener('resize', () => { if (innerWidth !== before) { before = innerWidth; views.forEach(view => view.draw()); } });
root.dataset.ready = views.length;
