// The part of Preact that the page uses, for `tsc --noEmit`.
export type Child = unknown;
export function h(kind: string | ((props: any) => any) | (new (props: any) => any), props?: any, ...children: Child[]): any;
export function render(what: any, where: Element): void;
export function createRef(): { current: any };
export class Component {
  constructor(props: any);
  props: any;
  forceUpdate(): void;
}
