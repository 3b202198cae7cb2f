// What a view is.
import type { Route } from '../router';

export interface View {
  title: string;
  element: HTMLElement;
  // Shows another address of the same view; false: a new view is needed.
  follow?(route: Route): boolean;
  close(): void;
}
