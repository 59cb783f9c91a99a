// The page has the place that a keyboard on the screen leaves, so that STOP is above it.

/** An upright phone below this height and width leaves out what is not needed to type and to stop, px. */
const LOW_PX = 460, NARROW_PX = 600;

/** Keeps the page within what is seen. Browsers that resize the page themselves (`interactive-widget`) do not need it. */
export function fit(): void {
    const seen = window.visualViewport;
    if (!seen) return;
    const { body } = document;
    const place = () => {
        // Who has zoomed in sees a part of a page of the same size.
        const height = Math.round(seen.height * seen.scale), width = seen.width * seen.scale;
        body.style.height = `${height}px`;
        body.classList.toggle("low", height < LOW_PX && width < NARROW_PX);
        // A browser that moves what is seen, to show a field, would leave STOP behind.
        body.style.translate = seen.scale === 1 && seen.offsetTop > 0 ? `0 ${seen.offsetTop}px` : "";
    };
    seen.addEventListener("scroll", place);
    seen.addEventListener("resize", () => {
        place();
        const field = document.activeElement;
        if (field instanceof HTMLInputElement || field instanceof HTMLTextAreaElement) field.scrollIntoView({ block: "nearest" });
    });
    place();
}
