// Makes DOM elements. Text always becomes text nodes, so that no name can become markup.

export type Child = Node | string | number | null | undefined | false | Child[];
type Handler = (event: any) => void;
export type Attributes = Record<string, string | number | boolean | null | undefined | Handler | Partial<CSSStyleDeclaration>>;

function setAttributes(element: HTMLElement | SVGElement, attributes: Attributes): void {
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (typeof value === 'function') {
      (element as any)[name] = value; // "onclick": `morph` copies these properties
    } else if (name === 'style') {
      Object.assign(element.style, value); // by CSSOM: a style attribute is refused by the content security policy
    } else if (name === 'value' || name === 'checked' || name === 'indeterminate' || name === 'selected') {
      (element as any)[name] = value;
    } else {
      element.setAttribute(name, value === true ? '' : String(value));
    }
  }
}

function append(parent: Node, children: Child[]): void {
  for (const child of children) {
    if (child === null || child === undefined || child === false) continue;
    if (Array.isArray(child)) append(parent, child);
    else parent.appendChild(child instanceof Node ? child : document.createTextNode(String(child)));
  }
}

// An HTML element. `attributes`: attributes; properties value and checked; `style` as an object; handlers as "onclick".
export function h<K extends keyof HTMLElementTagNameMap>(tag: K, attributes: Attributes = {}, ...children: Child[]):
    HTMLElementTagNameMap[K] {
  const element = document.createElement(tag);
  append(element, children); // first: the value of a select needs its options
  setAttributes(element, attributes);
  return element;
}

// An SVG element.
export function svg<K extends keyof SVGElementTagNameMap>(tag: K, attributes: Attributes = {}, ...children: Child[]):
    SVGElementTagNameMap[K] {
  const element = document.createElementNS('http://www.w3.org/2000/svg', tag);
  append(element, children);
  setAttributes(element, attributes);
  return element;
}

const kHandlers = ['onclick', 'onchange', 'oninput', 'onkeydown', 'onsubmit', 'ontoggle', 'onpointermove',
  'onpointerleave', 'onpointerdown', 'ondblclick'] as const;

function keyOf(node: Node): string | null {
  return node instanceof Element ? node.getAttribute('data-key') : null;
}

function sameKind(a: Node, b: Node): boolean {
  return a.nodeType === b.nodeType && a.nodeName === b.nodeName && keyOf(a) === keyOf(b);
}

// Changes `old` so that it equals `wanted`, and keeps elements that are in both, with their focus and scroll position.
// Children are matched by the attribute data-key, others by their order. The content of an element with data-island is
// left as it is. Elements of `wanted` may be moved into `old`.
export function morph(old: Element, wanted: Element): void {
  for (const { name } of [...old.attributes]) {
    if (name !== 'style' && name !== 'open' && !wanted.hasAttribute(name)) old.removeAttribute(name);
  }
  for (const { name, value } of [...wanted.attributes]) {
    if (name !== 'style' && name !== 'open' && old.getAttribute(name) !== value) old.setAttribute(name, value);
  }
  const oldStyle = (old as HTMLElement).style, wantedStyle = (wanted as HTMLElement).style;
  if (oldStyle.cssText !== wantedStyle.cssText) oldStyle.cssText = wantedStyle.cssText;
  for (const handler of kHandlers) {
    if ((old as any)[handler] !== (wanted as any)[handler]) (old as any)[handler] = (wanted as any)[handler];
  }
  if (!old.hasAttribute('data-island')) morphChildren(old, wanted);
  if (old instanceof HTMLInputElement) {
    const other = wanted as HTMLInputElement;
    old.checked = other.checked;
    old.indeterminate = other.indeterminate;
    if (document.activeElement !== old && old.value !== other.value) old.value = other.value;
  } else if (old instanceof HTMLSelectElement && document.activeElement !== old) {
    old.value = (wanted as HTMLSelectElement).value;
  }
}

function morphChildren(old: Element, wanted: Element): void {
  const keyed = new Map<string, ChildNode>();
  for (const child of old.childNodes) {
    const key = keyOf(child);
    if (key !== null) keyed.set(key, child);
  }
  let next: ChildNode | null = old.firstChild;
  for (const child of [...wanted.childNodes]) {
    const key = keyOf(child);
    let match: ChildNode | null = null;
    if (key !== null) {
      match = keyed.get(key) ?? null;
      if (match && !sameKind(match, child)) match = null;
    } else {
      while (next && keyOf(next) !== null && !wantedKey(wanted, keyOf(next)!)) {
        const gone: ChildNode = next;
        next = next.nextSibling;
        gone.remove();
      }
      if (next && sameKind(next, child)) match = next;
    }
    if (!match) {
      old.insertBefore(child, next);
      continue;
    }
    if (match === next) next = next.nextSibling;
    else old.insertBefore(match, next);
    if (match instanceof Element) morph(match, child as Element);
    else if (match.nodeValue !== child.nodeValue) match.nodeValue = child.nodeValue;
  }
  while (next) {
    const gone: ChildNode = next;
    next = next.nextSibling;
    gone.remove();
  }
}

function wantedKey(wanted: Element, key: string): boolean {
  for (const child of wanted.children) if (child.getAttribute('data-key') === key) return true;
  return false;
}

// Changes the children of `parent` to `children`, as `morph`.
export function renderInto(parent: Element, ...children: Child[]): void {
  const wanted = parent.cloneNode(false) as Element;
  for (const handler of kHandlers) (wanted as any)[handler] = (parent as any)[handler];
  append(wanted, children);
  if (wanted instanceof HTMLElement) wanted.style.cssText = (parent as HTMLElement).style.cssText;
  morph(parent, wanted);
}

// A box that scrolls sideways, also by keyboard.
export function scrollBox(label: string, content: Child): HTMLElement {
  return h('div', { class: 'scroll', tabindex: 0, role: 'region', 'aria-label': label }, content);
}

// Puts `content` into the element with data-island=`name` below `root`, unless it is there already.
export function fillIsland(root: Element, name: string, content: Element): void {
  const island = root.querySelector(`[data-island="${name}"]`);
  if (island && content.parentElement !== island) island.replaceChildren(content);
}
