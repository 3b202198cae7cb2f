// The frame of the page: header, navigation, the line that says when the coordinator is away, and the current view.
import { ApiError } from './api/client';
import { isAwaySince, now_ms, onConnectionChange } from './api/connection';
import { currentSession, logOut, may, onSessionEnd, openSession } from './api/session';
import { notifyError } from './base/dialog';
import { h, renderInto } from './base/dom';
import { clockSeconds, duration } from './base/format';
import { address, currentRoute, type Route } from './router';
import { jobView } from './views/job';
import { jobsView } from './views/jobs';
import { loginView } from './views/login';
import { prepareResult, resultView } from './views/result';
import { submitView } from './views/submit';
import type { View } from './views/view';
import { workersView } from './views/workers';

const header = h('header', { class: 'top' });
const banner = h('div', { class: 'away', role: 'alert', hidden: true });
const main = h('main', { id: 'main', tabindex: -1 });
let view: View | null = null;
let sessionEnded = false;

function isCurrent(part: string, route: Route): boolean {
  return (route.parts[0] ?? 'jobs') === part;
}

function renderHeader(): void {
  const session = currentSession(), route = currentRoute();
  const link = (part: string, text: string) =>
    h('a', { href: address(part), 'aria-current': isCurrent(part, route) ? 'page' : null }, text);
  renderInto(header,
    h('a', { class: 'brand', href: address('jobs'), 'aria-label': 'Tessera: jobs' },
      h('span', { class: 'mark', 'aria-hidden': 'true' }), 'Tessera'),
    session && h('nav', { 'aria-label': 'Views' },
      link('jobs', 'Jobs'), link('workers', 'Workers'), may('CreateJob') && link('submit', 'Submit')),
    session && h('div', { class: 'who' },
      session.tokensRequired
        ? [h('span', {}, h('b', {}, session.name), ` ${session.role}`),
          h('button', { class: 'button small', onclick: endSession }, 'Log out')]
        : h('span', { title: 'This coordinator asks for no tokens' }, 'no token needed')));
}

async function endSession(): Promise<void> {
  try {
    await logOut();
  } catch (error) {
    notifyError(error);
  }
  sessionEnded = false;
  show();
}

function renderBanner(): void {
  const since = isAwaySince();
  banner.hidden = since === null;
  if (!since) return;
  renderInto(banner, h('b', {}, `The coordinator has not answered since ${clockSeconds(since)}`),
    h('span', { 'aria-live': 'off' }, ` (${duration((Date.now() - since.getTime()) / 1000)}). `),
    'Shown is the last known state. The page goes on by itself when the coordinator is back.');
}

function viewOf(route: Route): View {
  const [first, id, section] = route.parts;
  if (first === 'workers') return workersView();
  if (first === 'submit' && may('CreateJob')) return submitView(route);
  if (first === 'jobs' && id && section === 'result') return resultView(`jobs/${id}`, route);
  if (first === 'jobs' && id) return jobView(`jobs/${id}`, route);
  return jobsView(route);
}

function open(next: View): void {
  view?.close();
  view = next;
  main.replaceChildren(next.element);
  window.scrollTo(0, 0);
}

function setTitle(): void {
  if (view) document.title = `${view.title} · Tessera`;
}

// Shows the view of the current address.
function show(moveFocus = false): void {
  renderHeader();
  const route = currentRoute();
  main.classList.toggle('full', route.parts[2] === 'result' && currentSession() !== null);
  if (!currentSession()) {
    open(loginView(() => { sessionEnded = false; show(true); },
      sessionEnded ? 'The session has ended. Log in again.' : ''));
    main.querySelector<HTMLElement>('#token')?.focus();
  } else if (!view?.follow?.(route)) {
    open(viewOf(route));
    if (moveFocus) main.focus({ preventScroll: true });
  }
  setTitle();
}

async function start(): Promise<void> {
  const { parts } = currentRoute();
  if (parts[0] === 'jobs' && parts[1] && parts[2] === 'result') prepareResult(`jobs/${parts[1]}`); // beside the log-in
  document.getElementById('page')!.append(h('a', { class: 'skip', href: '#main', onclick: (event: Event) => {
    event.preventDefault();
    main.focus();
  } }, 'To the content'), header, banner, main);
  renderHeader();
  onConnectionChange(renderBanner);
  onSessionEnd(() => { sessionEnded = true; show(); });
  setInterval(() => { renderBanner(); setTitle(); }, 1000);
  window.addEventListener('hashchange', () => show(true));
  for (;;) {
    try {
      await openSession();
      break;
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      renderBanner();
      await new Promise((resolve) => setTimeout(resolve, 2000));
    }
  }
  document.documentElement.dataset['startedMs'] = String(Math.round(now_ms()));
  show();
}

void start();
