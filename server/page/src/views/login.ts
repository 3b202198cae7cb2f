// Log in with a token.
import { logIn } from '../api/session';
import { h } from '../base/dom';
import type { View } from './view';

export function loginView(onDone: () => void, why: string): View {
  const field = h('input', {
    id: 'token', type: 'password', autocomplete: 'current-password', required: true, spellcheck: 'false',
    autocapitalize: 'off', 'aria-describedby': 'token-help',
  });
  const fault = h('p', { class: 'fault', role: 'alert' });
  const button = h('button', { type: 'submit', class: 'button primary wide' }, 'Log in');
  const element = h('div', { class: 'login' },
    h('h1', {}, 'Log in'),
    why && h('p', { class: 'note' }, why),
    h('form', {
      onsubmit: async (event: SubmitEvent) => {
        event.preventDefault();
        fault.textContent = '';
        button.disabled = true;
        try {
          await logIn(field.value.trim());
          onDone();
        } catch (error) {
          const text = (error instanceof Error ? error.message : String(error)).replace(/^unauthenticated: /, '');
          fault.textContent = text.charAt(0).toUpperCase() + text.slice(1);
          field.select();
        } finally {
          button.disabled = false;
        }
      },
    },
    h('p', { class: 'field' }, h('label', { for: 'token' }, 'Token'), field),
    h('p', { id: 'token-help', class: 'soft' }, 'The content of your file NAME.token. The administrator makes it with ',
      h('code', {}, 'tessera access token'), '.'),
    fault, button));
  return { title: 'Log in', element, close() {} };
}
