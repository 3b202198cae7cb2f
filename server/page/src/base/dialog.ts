// Modal dialogs and short notices.
import { type Child, h } from './dom';

// Asks a question. Answers the chosen value: `true` for the button, or the number of the field; null if it is refused.
export function ask(question: {
  title: string; text: Child[]; button: string; danger?: boolean; integer?: { label: string; low: number; high: number; value: number };
}): Promise<true | number | null> {
  return new Promise((resolve) => {
    const field = question.integer && h('input', {
      type: 'number', id: 'dialog-number', min: question.integer.low, max: question.integer.high, step: 1,
      required: true, value: question.integer.value,
    });
    let answer: true | number | null = null;
    const dialog = h('dialog', { class: 'dialog', 'aria-labelledby': 'dialog-title' },
      h('form', {
        onsubmit: (event: SubmitEvent) => {
          event.preventDefault();
          answer = field ? field.valueAsNumber : true;
          dialog.close();
        },
      },
      h('h2', { id: 'dialog-title' }, question.title),
      ...question.text,
      field && question.integer && h('p', { class: 'field' },
        h('label', { for: 'dialog-number' }, question.integer.label), field),
      h('div', { class: 'buttons end' },
        h('button', { type: 'button', class: 'button', onclick: () => dialog.close() }, 'Back'),
        h('button', { type: 'submit', class: `button ${question.danger ? 'danger' : 'primary'}` }, question.button))));
    dialog.addEventListener('close', () => {
      dialog.remove();
      resolve(answer);
    });
    document.body.append(dialog);
    dialog.showModal();
    (field ?? dialog.querySelector<HTMLElement>('button[type=button]'))?.focus();
  });
}

const kNotice_ms = 6000;

// Shows a sentence for some seconds; errors stay until they are closed.
export function notify(text: string, bad = false): void {
  let list = document.getElementById('notices');
  if (!list) {
    list = h('div', { id: 'notices', role: 'status', 'aria-live': 'polite' });
    document.body.append(list);
  }
  const notice = h('div', { class: bad ? 'notice bad' : 'notice' }, h('span', {}, text),
    h('button', { class: 'close', 'aria-label': 'Close this message', onclick: () => notice.remove() }, '×'));
  list.append(notice);
  if (!bad) setTimeout(() => notice.remove(), kNotice_ms);
}

export function notifyError(error: unknown): void {
  notify(error instanceof Error ? error.message : String(error), true);
}
